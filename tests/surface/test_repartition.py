"""Meshes repartitioned across the contact: the same cells and tags, evenly distributed."""

import numpy as np
import pytest
from scenes import WORLD, box, elevated, plane, raises_everywhere

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


def integral(msh, f, measure):
    """Return the integral of an expression of the coordinates over all ranks."""
    x = ufl.SpatialCoordinate(msh)
    return WORLD.allreduce(fem.assemble_scalar(fem.form(f(x) * measure)))


def moments(msh, tags):
    """Return integrals over cells and tagged facets that differ between meshes."""
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    dx = ufl.Measure("dx", domain=msh)
    return [integral(msh, lambda x: ufl.exp(x[0] - x[1]), m) for m in (dx, ds(1), ds(2))]


def tagged(msh):
    """Make tags of two sides."""
    sides = [plane(msh, 1, value) for value in (0.0, 1.0)]
    indices = np.concatenate(sides)
    values = np.repeat([1, 2], [len(side) for side in sides]).astype(np.int32)
    order = np.argsort(indices)
    tags = mesh.meshtags(msh, msh.topology.dim - 1, indices[order], values[order])
    tags.name = "sides"
    return tags


@pytest.mark.parametrize("partition", ("forward", "scattered", "first"))
@pytest.mark.parametrize("degree", (1, 2, 3))
@pytest.mark.parametrize("cell", CELLS)
def test_the_same_mesh(cell, degree, partition):
    """The mesh is the same, also with curved cells; cells and surface are evenly distributed."""
    dim = CELLS[cell]
    msh = box(WORLD, [6] * dim, cell, [0.0] * dim, [1.0] * dim, partition)
    if degree > 1:
        msh = elevated(msh, degree)
        msh.geometry.x[:, 0] += 0.05 * np.sin(3 * msh.geometry.x[:, 1])
    msh.name = "body"
    tags = tagged(msh)
    directions = np.delete(np.eye(dim), 1, axis=0)
    new, moved = qs.repartition(msh, directions, tags)
    np.testing.assert_allclose(moments(new, moved), moments(msh, tags), rtol=1e-12)
    assert (new.name, moved.name, moved.values.dtype) == ("body", "sides", np.int32)
    count = new.topology.index_map(dim)
    assert abs(count.size_local - count.size_global / WORLD.size) < 1.01
    facets = WORLD.allgather(len(moved.find(1)))
    assert max(facets) <= np.ceil(sum(facets) / WORLD.size) + 2 * 6 ** (dim - 2)


def test_other_tags():
    """Tags of cells, as floats, and of edges that ranks share, are transferred."""
    msh = box(WORLD, [3, 3, 3], "tetrahedron", [0.0] * 3, [1.0] * 3)
    tdim = msh.topology.dim
    cells = np.arange(msh.topology.index_map(tdim).size_local, dtype=np.int32)
    middles = mesh.compute_midpoints(msh, tdim, cells)
    of_cells = mesh.meshtags(msh, tdim, cells, middles @ [1.0, 2.0, 3.0])
    edges = mesh.locate_entities(msh, 1, lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0))
    of_edges = mesh.meshtags(msh, 1, edges, np.full(len(edges), 7, dtype=np.int32))
    new, found, lines = qs.repartition(msh, [[1, 1, 0]], of_cells, of_edges)
    middles = mesh.compute_midpoints(new, tdim, found.indices)
    count = WORLD.allreduce(len(found.indices))
    assert count == new.topology.index_map(tdim).size_global
    np.testing.assert_allclose(found.values, middles @ [1.0, 2.0, 3.0], rtol=1e-12)
    owned = lines.indices < new.topology.index_map(1).size_local
    assert WORLD.allreduce(np.count_nonzero(owned)) == 3 and np.all(lines.values == 7)


@pytest.mark.parametrize("ghosts", ("none", "shared_facet"))
def test_ranks_without_cells(ghosts):
    """With fewer cells than ranks every facet keeps its tag, also where ghosts had tags."""
    msh = mesh.create_unit_square(
        WORLD, 2, 1, mesh.CellType.quadrilateral, ghost_mode=mesh.GhostMode[ghosts]
    )
    msh.topology.create_entities(1)
    count = msh.topology.index_map(1)
    facets = np.arange(count.size_local + count.num_ghosts, dtype=np.int32)
    tags = mesh.meshtags(msh, 1, facets, place(msh, facets))
    none = mesh.meshtags(msh, 0, facets[:0], facets[:0])
    new, moved, empty = qs.repartition(msh, [[1.0, 0.0]], tags, none)
    count = new.topology.index_map(1)
    assert len(moved.indices) == count.size_local + count.num_ghosts and len(empty.indices) == 0
    np.testing.assert_array_equal(moved.values, place(new, moved.indices))


def place(msh, facets):
    """Return numbers that identify facets by their position."""
    msh.topology.create_connectivity(1, 2)
    middles = mesh.compute_midpoints(msh, 1, facets) if len(facets) else np.zeros((0, 3))
    return np.rint(100 * middles @ [1.0, 7.0, 0.0]).astype(np.int32)


def test_contact_is_shared():
    """The forces are the same as before, from contact quadrature points of all ranks."""
    forces = []
    for cut in (False, True):
        bodies = []
        for low, n in ((0.0, 5), (1.0, 4)):
            msh = box(WORLD, [n] * 3, "hexahedron", [0, 0, low], [1, 1, low + 1], "forward")
            if cut:
                (msh,) = qs.repartition(msh, [[1, 0, 0], [0, 1, 0]])
            V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
            u = fem.Function(V)
            F = ufl.inner(qs.materials.linear_elastic(u, 10.0, 0.3), ufl.grad(ufl.TestFunction(V)))
            dofs = fem.locate_dofs_topological(V, 2, plane(msh, 2, 2 * low))
            bcs = [fem.dirichletbc(np.array([0.0, 0.0, -0.1 * low]), dofs, V)]
            bodies.append((F * ufl.dx, u, bcs, qs.Surface(V, facets=plane(msh, 2, 1.0))))
        forms, u, bcs, surfaces = zip(*bodies, strict=True)
        contact = qs.Contact(*surfaces)
        qs.ContactProblem(list(forms), list(u), [contact], list(bcs)).solve()
        forces.append(contact.force("slave"))
        points = WORLD.allgather(len(surfaces[0].facets))
    np.testing.assert_allclose(*forces, atol=1e-7 * np.abs(forces[0]).max())
    assert max(points) <= np.ceil(25 / WORLD.size) + 5


@pytest.mark.parametrize(
    "directions",
    ([], [[0.0, 0.0]], [[1.0, 0.0, 0.0]], [1.0, 0.0], "x", [[1.0], [0, 1]], [[np.nan, 1]]),
)
def test_bad_directions(directions):
    msh = box(WORLD, [2, 2], "triangle", [0.0, 0.0], [1.0, 1.0])
    raises_everywhere(WORLD, ValueError, "directions", lambda: qs.repartition(msh, directions))


def test_bad_tags():
    one, other = (box(WORLD, [2, 2], "triangle", [0.0, 0.0], [1.0, 1.0]) for _ in range(2))
    directions, tags = [[1.0, 0.0]], tagged(other)
    raises_everywhere(WORLD, ValueError, "tags", lambda: qs.repartition(one, directions, tags))
    raises_everywhere(WORLD, TypeError, "tags", lambda: qs.repartition(one, directions, 3))
