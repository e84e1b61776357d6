"""Several bodies on one mesh: time steps refuse several unknowns, and accept one for all bodies."""

import numpy as np
import pytest
from scenes import WORLD, blocks, clamp, elastic, plane, raises_everywhere, vector_space

from dolfinx import fem, mesh

import qsdolfinx as qs

KINDS = ("velocity", "displacement")
LOWER, UPPER = ([0.0, -1.0], [1.0, 0.0]), ([0.0, 0.0], [1.0, 1.0])
DT, SPEED = 0.1, 0.4


def faces(V, upper):
    """Surface at y = 0 of the upper or the lower block."""
    msh = V.mesh
    found = plane(msh, 1, 0.0)
    msh.topology.create_connectivity(1, 2)
    to_cell = msh.topology.connectivity(1, 2)
    cells = np.array([to_cell.links(f)[0] for f in found], dtype=np.int32)
    middle = mesh.compute_midpoints(msh, 2, cells)[:, 1]
    return qs.Surface(V, facets=found[(middle > 0) == upper])


def contact_of(slave, master, kinds):
    options = {"dt": DT} if "velocity" in kinds else {}
    return qs.Contact(slave, master, penalty=50.0, unknown=kinds, **options)


@pytest.mark.parametrize("second", KINDS)
@pytest.mark.parametrize("first", KINDS)
def test_refused(first, second):
    """Two unknowns on one mesh are refused, because each would move the mesh."""
    msh = blocks(LOWER, UPPER)
    V = [vector_space(msh), vector_space(msh)]
    u = [fem.Function(space) for space in V]
    contact = contact_of(faces(V[1], True), faces(V[0], False), (second, first))
    problem = qs.ContactProblem([elastic(w) for w in u], u, [contact])
    message = "u[0] and u[1] are on one mesh"
    x = msh.geometry.x.copy()
    raises_everywhere(WORLD, ValueError, message, lambda: qs.TimeStepper(problem, DT))
    assert np.array_equal(msh.geometry.x, x)


@pytest.mark.parametrize("kind", KINDS)
def test_one_unknown_for_both(kind):
    """One unknown for both bodies gives the same forces as a mesh for each body."""
    histories = []
    for boxes in ([LOWER, UPPER], [(LOWER, UPPER)]):
        meshes = [blocks(*(b if isinstance(b[0], tuple) else (b,))) for b in boxes]
        V = [vector_space(msh) for msh in meshes]
        u = [fem.Function(space) for space in V]
        contact = contact_of(faces(V[-1], True), faces(V[0], False), (kind, kind))
        down = fem.Constant(meshes[-1], (0.0, 0.0))
        bcs = [[] for _ in V]
        bcs[0].append(clamp(V[0], plane(meshes[0], 1, -1.0)))
        top = fem.locate_dofs_topological(V[-1], 1, plane(meshes[-1], 1, 1.0))
        bcs[-1].append(fem.dirichletbc(down, top, V[-1]))
        problem = qs.ContactProblem([elastic(w) for w in u], u, [contact], bcs)

        def drive(t, dt, down=down):
            down.value = (0.0, -SPEED * (1.0 if kind == "velocity" else t))

        stepper = qs.TimeStepper(problem, DT, drive)
        histories.append([contact.force("slave")[1] for _ in stepper.run(3 * DT)])
    assert min(histories[0]) > 0.01
    np.testing.assert_allclose(*histories, rtol=1e-9)
