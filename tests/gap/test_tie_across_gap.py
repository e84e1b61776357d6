"""Ties across a gap: the vector across the gap rotates with the facets of the master."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, Pair, clamp, elastic, gathered, largest, plane, slide
from tangents import direction, near_solution, tangent_errors

import qsdolfinx as qs

GAP = 0.3


def tied(cell, wave=0.0, **options):
    options = {"search_radius": 1.0} | options
    return Pair(cell, law=qs.Tied(), gap=GAP, wave=wave, contact_options=options)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize(
    "cell, wave", [*((cell, 0.0) for cell in CELLS), ("tetrahedron", 0.05), ("hexahedron", 0.05)]
)
def test_moment(cell, wave, quadrature):
    """The moments of both sides are opposite: couples balance the force across the gap.

    Between wavy surfaces gaps are not normal to the facets.
    """
    pair = tied(cell, wave, quadrature=quadrature)
    shift = np.zeros(pair.gdim)
    shift[0] = 0.05
    pair.bcs[1][:] = [clamp(pair.V[1], plane(pair.meshes[1], pair.gdim - 1, 1.0 + GAP), shift)]
    pair.problem(solver="direct").solve()
    moments = [pair.contact.moment(side, np.zeros(pair.gdim)) for side in ("slave", "master")]
    force = pair.contact.force("slave")
    assert abs(force[0]) * GAP > 1e-3
    np.testing.assert_allclose(moments[0], -moments[1], atol=1e-9)


@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_patch(cell, sliding):
    """Tied bars in series across a gap have uniform tractions."""
    pair = tied(cell, quadrature="overlay", enforcement="augmented-lagrangian", sliding=sliding)
    pair.F[:] = [elastic(u, E=1.0 + i, nu=0.0) for i, u in enumerate(pair.u)]
    pair.problem(solver="direct").solve()
    traction = gathered(WORLD, pair.slave.node_values(pair.contact.traction("slave")))
    expected = np.zeros(pair.gdim)
    expected[-1] = 0.1 / (1 + 1 / 2)
    np.testing.assert_allclose(traction, np.broadcast_to(expected, traction.shape), atol=1e-8)


@pytest.mark.parametrize("held", (False, True))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_tangent(cell, held):
    """The tangent is symmetric and agrees with differences of the residual.

    Conditions on both sides may hold a component of tied nodes.
    """
    pair = tied(cell, quadrature="overlay")
    for V, bcs in zip(pair.V, pair.bcs, strict=True) if held else ():
        bcs.append(slide(V, 0, plane(V.mesh, 0, 0.0)))
    problem = pair.problem()
    problem.solve()
    rng = np.random.default_rng(1)
    x = near_solution(problem, rng, 0.01)
    errors = tangent_errors(problem, x, direction(problem, rng), 1e-4)
    assert errors.difference < 1e-8 and errors.asymmetry < 1e-12


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_meshes_that_have_been_stretched(quadrature):
    """A slave mesh moved by t and displaced by -t has no jump, whatever the change of its area."""
    pair = tied("triangle", quadrature=quadrature)
    t = np.array([0.0, 0.05])
    pair.bcs[1][:] = [clamp(pair.V[1], plane(pair.meshes[1], 1, 1.0 + GAP), -t)]
    for msh in pair.meshes:
        msh.geometry.x[:, 0] *= 1.5
    pair.meshes[1].geometry.x[:, :2] += t
    pair.contact.update()
    pair.problem(solver="direct").solve()
    assert largest(pair.u[1].x.array.reshape(-1, 2) + t, pair.u[0].x.array) < 1e-12
