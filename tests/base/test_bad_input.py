"""Invalid input raises one clear error, the same on every rank, which names the argument."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    elastic,
    plane,
    raises_everywhere,
    vector_space,
)

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.base.collective import collective_errors


def square(cell="triangle", n=4):
    msh = box(WORLD, [n, n], cell, [0, 0], [1, 1])
    return msh, vector_space(msh), plane(msh, 1, 0.0)


def surface_error(error, match, V, *args, **kwargs):
    raises_everywhere(WORLD, error, match, lambda: qs.Surface(V, *args, **kwargs))


def test_intervals():
    msh = mesh.create_unit_interval(WORLD, 8)
    V = fem.functionspace(msh, ("Lagrange", 1, (1,)))
    surface_error(ValueError, "triangles", V, facets=np.array([0], dtype=np.int32))


def test_coordinates():
    for value, match in ((np.nan, "finite"), (np.inf, "finite")):
        msh, V, facets = square()
        msh.geometry.x[np.isclose(msh.geometry.x[:, 1], 0), 0] = value
        surface_error(ValueError, match, V, facets=facets)
    msh, V, facets = square()
    surface = qs.Surface(V, facets=facets)
    msh.geometry.x[np.isclose(msh.geometry.x[:, 1], 0), 0] = np.nan
    raises_everywhere(WORLD, ValueError, "finite", surface.update)


@pytest.mark.parametrize("place", ((0.45, 0.45), (0.5, 0.5), (1.2, 1.2)))
def test_quadrilaterals_that_are_not_convex(place):
    """Quadrilaterals with a corner on or across the diagonal of the facet are refused."""
    msh = box(WORLD, [1, 1, 1], "hexahedron", [0, 0, 0], [1, 1, 1])
    x = msh.geometry.x
    x[np.all(np.isclose(x, [1, 1, 0]), axis=1), :2] = place
    V, facets = vector_space(msh), plane(msh, 2, 0.0)
    if place[0] > 0.5:
        assert np.isclose(qs.Surface(V, facets=facets).area, 1.2)
    else:
        surface_error(ValueError, "convex", V, facets=facets)


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_degenerate_facets(cell):
    gdim = 2 if cell == "triangle" else 3
    msh = box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
    facets = plane(msh, gdim - 1, 0.0)
    x = msh.geometry.x
    x[np.isclose(x[:, gdim - 1], 0) & (x[:, 0] < 0.4), 0] = 0  # the first row of facets has no area
    surface_error(ValueError, "zero area", vector_space(msh), facets=facets)


def test_exceptions_that_cannot_travel():
    """Whatever one rank raises, all ranks raise an error, and none hangs."""

    class Local(Exception):
        pass

    for error in (Local("this"), UnicodeDecodeError("utf-8", b"", 0, 1, "this"), PETSc.Error(62)):
        found = None
        try:
            with collective_errors(WORLD):
                if WORLD.rank == WORLD.size - 1:
                    raise error
        except Exception as e:
            found = e
        assert found is not None
        travels = WORLD.rank == WORLD.size - 1 or not isinstance(error, Local)
        assert isinstance(found, type(error) if travels else RuntimeError)


def test_penalty_that_is_not_known_yet():
    pair = Pair("triangle", penalty="auto")
    raises_everywhere(WORLD, RuntimeError, "first solve", lambda: pair.contact.model.eps)


def test_stiffness_that_is_not_finite():
    """A NaN coefficient or unknown is reported as not finite, not as missing stiffness."""
    for solver in ("direct", "amg"):
        pair = Pair("triangle", penalty="auto")
        coefficient = fem.Constant(pair.V[1].mesh, np.nan)
        pair.F[1] = elastic(pair.u[1], E=coefficient)
        problem = pair.problem(solver=solver)
        for _ in range(2):
            raises_everywhere(WORLD, ValueError, "slave's body is not finite", problem.solve)
        coefficient.value = 1.0
        problem.solve()


def test_conditions_of_one_rank_alone():
    """Conditions that differ between ranks are refused: the last rank has one less for a body."""
    pair = Pair("triangle")
    last = WORLD.rank == WORLD.size - 1 and WORLD.size > 1
    pair.bcs[1] = [] if last else pair.bcs[1]
    if WORLD.size == 1:
        pair.problem()
    else:
        raises_everywhere(WORLD, ValueError, "bcs: must be the same", pair.problem)


def test_named_after_what_causes_it():
    """Errors name the argument that causes them, on all ranks.

    Examples: friction with a tie, and a friction penalty without friction.
    """
    pair = Pair("triangle")
    both = pair.slave, pair.master
    for name, options in (
        ("friction: tied", {"law": qs.Tied(), "friction": qs.Coulomb(0.1)}),
        ("friction_penalty: needs", {"friction_penalty": 1.0}),
        ("dt: ", {"unknown": "velocity"}),
    ):
        raises_everywhere(WORLD, ValueError, name, lambda o=options: qs.Contact(*both, **o))


@pytest.mark.parametrize("height", [0.0, 0.5])
def test_nothing_is_changed(height):
    """NaN in a contact facet, or elsewhere in its cell, is refused, and the state is kept."""
    pair = Pair("quadrilateral")
    before, node = pair.contact.pairing, pair.slave.node_x.copy()
    x = pair.meshes[1].geometry.x
    x[np.isclose(x[:, 1], height)] = np.nan
    raises_everywhere(WORLD, ValueError, "finite", pair.contact.update)
    np.testing.assert_array_equal(before.slave.x, pair.contact.pairing.slave.x)
    np.testing.assert_array_equal(node, pair.slave.node_x)
