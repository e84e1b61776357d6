"""Friction at contact nodes with Dirichlet conditions, which the tangent excludes."""

import numpy as np
import pytest
from scenes import WORLD, Pair, clamp, drag_top, largest, plane, slide

import qsdolfinx as qs

#: Newton iterations after which a constraint whose slip has reversed has its tangent again.
SETTLED = 6
FRICTION = {
    "coulomb": lambda: qs.Coulomb(0.3),
    "tresca": lambda: qs.Tresca(0.01),
    "norton": lambda: qs.Norton(0.3, 0.4, 0.3),
    "sticking": lambda: qs.Sticking(),
}


def pressed(cell, law, quadrature, kind, unknown):
    """Make two blocks held on their sides at x = 0, the lower one up to the contact's corner.

    They have been pressed together and dragged.
    """
    options = {"friction": FRICTION[law](), "quadrature": quadrature, "unknown": unknown}
    if law == "norton" or unknown != "displacement":
        options["dt"] = 0.5
    n = (8, 6) if cell == "triangle" else (3, 2)
    pair = Pair(cell, n=n, wave=0.03, contact_options=options)
    drag_top(pair, 0.0)
    pair.bcs[0].append(clamp(pair.V[0], plane(pair.meshes[0], 0, 0.0)))
    pair.bcs[1].append(slide(pair.V[1], pair.gdim - 1, plane(pair.meshes[1], 0, 0.0), -0.03))
    pair.bcs[1].append(slide(pair.V[1], 0, plane(pair.meshes[1], 0, 0.0), 0.01))
    pair.bcs[1].reverse()  # where two conditions meet, the value of the top counts
    problem = pair.problem(kind=kind)
    problem.solve()
    return pair, problem


def held(pair):
    """Return whether each of this rank's unknowns of all bodies has a Dirichlet condition."""
    out = []
    for V, bcs in zip(pair.V, pair.bcs, strict=True):
        owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
        marked = np.zeros(owned, dtype=bool)
        for bc in bcs:
            dofs = bc.dof_indices()[0]
            marked[dofs[dofs < owned]] = True
        out.append(marked)
    return np.concatenate(out)


def smooth(pair, seed):
    """Return a vector of all bodies' owned unknowns; it is the same on any partition."""
    rng, out = np.random.default_rng(seed), []
    for V in pair.V:
        owned = V.dofmap.index_map.size_local
        waves, phases = rng.normal(size=(8, 3)) * 6, rng.random((8, pair.gdim)) * 6
        x = V.tabulate_dof_coordinates()[:owned]
        out.append(np.sin((x @ waves.T)[:, :, None] + phases).mean(axis=1).ravel())
    return np.concatenate(out)


@pytest.mark.parametrize(
    "quadrature, kind, unknown",
    (
        ("nodal", "mpi", "displacement"),
        ("overlay", "nest", "displacement"),
        ("overlay", "mpi", ("velocity", "displacement")),
        ("nodal", "nest", "velocity"),
    ),
)
@pytest.mark.parametrize("law", FRICTION)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_tangent(cell, law, quadrature, kind, unknown):
    """The tangent is the derivative of the residual in all directions, held unknowns included.

    For held unknowns the residual is the difference to the prescribed value, as if the condition
    were imposed separately.
    """
    pair, problem = pressed(cell, law, quadrature, kind, unknown)
    contact, conditions = pair.contact, held(pair)
    snes = problem.snes
    tangent, residual = snes.getJacobian()[0], snes.getFunction()[0]
    x, d, product = (snes.getSolution().duplicate() for _ in range(3))
    snes.getSolution().copy(x)
    x.array[:] += np.where(conditions, 0.0, 0.02 * smooth(pair, 5))
    d.array[:] = smooth(pair, 6)
    surfaces = pair.master, pair.slave
    touched = [
        WORLD.allreduce(np.count_nonzero(conditions[offset + s.node_dofs - first]))
        for s, offset, first in zip(surfaces, *layout(pair), strict=True)
    ]
    f = [residual.duplicate() for _ in range(2)]
    step = 1e-7
    for sign, vec in zip((1, -1), f, strict=True):
        y = x.copy()
        y.axpy(sign * step, d)
        snes.computeFunction(y, vec)
    for _ in range(SETTLED):
        snes.computeFunction(x, residual)
        snes.computeJacobian(x, tangent)
    active = WORLD.allreduce(np.count_nonzero(contact.active()))
    slipping = WORLD.allreduce(np.count_nonzero(contact.slipping()))
    tangent.mult(d, product)
    difference = (f[0].array_r - f[1].array_r) / (2 * step)
    assert min(touched) > 0
    assert active > 0 and (slipping > 0 or law == "sticking")
    assert largest(difference - product.array_r) < 1e-5 * largest(product.array_r)
    stiffness = np.concatenate(
        [np.full(body.num_owned, body.condition_stiffness) for body in problem.bodies]
    )
    wrong = (product.array_r - stiffness * d.array_r)[conditions]
    assert largest(wrong) < 1e-12 * stiffness.max()
    # Held unknowns have no columns either: they do not enter the equations of the others.
    d.array[~conditions] = 0
    tangent.mult(d, product)
    assert largest(product.array_r[~conditions]) == 0


def layout(pair):
    """Return where the unknowns of each body begin, on this rank and in the space's numbering."""
    sizes = [V.dofmap.index_map.size_local * V.dofmap.index_map_bs for V in pair.V]
    firsts = [V.dofmap.index_map.local_range[0] * V.dofmap.index_map_bs for V in pair.V]
    return np.cumsum([0, *sizes])[:-1], firsts
