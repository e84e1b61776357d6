"""Surfaces: nodal areas, normals, and the function spaces that they support."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import CELLS, PARTITIONS, WORLD, box, gathered, mini_space, plane, vector_space

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def wavy(cell, partition=None, comm=WORLD):
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    msh = box(comm, [3, 2, 2][:gdim], cell, [0.0] * gdim, [1.0] * gdim, partition)
    facets = plane(msh, 0, 1.0)
    x = msh.geometry.x
    x[:, 0] += 0.2 * x[:, 0] * np.sin(3 * x[:, 1] + 2 * x[:, 2])
    return msh, facets


@pytest.mark.parametrize("partition", PARTITIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_nodal_areas_and_normals(cell, partition):
    """S_k = ∫ N_k ds and the weighted normals agree with integrals of DOLFINx."""
    msh, facets = wavy(cell, partition)
    V = vector_space(msh)
    surface = qs.Surface(V, facets=facets)
    tags = mesh.meshtags(msh, msh.topology.dim - 1, np.sort(facets), np.ones(len(facets), np.int32))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags, metadata={"quadrature_degree": 8})
    v = ufl.TestFunction(V)
    one = ufl.as_vector([1.0] + [0.0] * (msh.geometry.dim - 1))

    def assemble(integrand):
        b = fem.petsc.assemble_vector(fem.form(integrand * ds(1)))
        b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        return b.array[surface.node_dofs - b.owner_range[0]]

    area = assemble(ufl.inner(one, v))[:, 0]
    normal = assemble(ufl.inner(ufl.FacetNormal(msh), v))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    total = WORLD.allreduce(area.sum())
    surface_area = surface.area  # all collective calls precede what may fail on one rank
    # On a bilinear facet neither quadrature rule is exact.
    tolerance = 1e-4 if cell == "hexahedron" else 1e-13
    np.testing.assert_allclose(surface.node_area, area, rtol=tolerance)
    np.testing.assert_allclose(
        surface.node_normal[:, : msh.geometry.dim], normal, atol=10 * tolerance
    )
    assert np.isclose(surface_area, total, rtol=tolerance)


@pytest.mark.parametrize("cell", CELLS)
def test_node_positions(cell):
    """node_x has the positions of node_dofs."""
    msh, facets = wavy(cell)
    V = vector_space(msh)
    surface = qs.Surface(V, facets=facets)
    first = V.dofmap.index_map.local_range[0]
    x = V.tabulate_dof_coordinates()[surface.node_dofs[:, 0] // msh.geometry.dim - first]
    count = WORLD.allreduce(len(x))
    np.testing.assert_allclose(surface.node_x, x, atol=1e-15)
    assert count == 3 ** (msh.geometry.dim - 1)


def test_facets_named_by_any_rank():
    """Tags, indices with or without ghosts, and indices on one rank give the same surface."""
    msh, facets = wavy("tetrahedron")
    V = vector_space(msh)
    owned = msh.topology.index_map(2).size_local
    tags = mesh.meshtags(msh, 2, np.sort(facets), np.full(len(facets), 7, np.int32))
    reference = qs.Surface(V, facets=facets)
    others = [
        qs.Surface(V, facets=facets[facets < owned]),
        qs.Surface(V, tags, 7),
        qs.Surface(V, facets=np.repeat(facets, 2)),
    ]
    for other in others:
        np.testing.assert_array_equal(other.facets, reference.facets)
        np.testing.assert_array_equal(other.node_dofs, reference.node_dofs)


def spaces(msh):
    gdim, cell = msh.geometry.dim, msh.basix_cell()
    p1 = basix.ufl.element("Lagrange", cell, 1, shape=(gdim,))
    p = basix.ufl.element("Lagrange", cell, 1)
    W = fem.functionspace(msh, basix.ufl.mixed_element([p1, p]))
    X = fem.functionspace(msh, basix.ufl.mixed_element([p, p1]))
    bubbled = mini_space(msh).ufl_element()
    M = fem.functionspace(msh, basix.ufl.mixed_element([bubbled, p]))
    return {
        "P1 with bubble": mini_space(msh),
        "first of mixed": W.sub(0),
        "last of mixed": X.sub(1),
        "MINI": M.sub(0),
    }


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
@pytest.mark.parametrize("name", ("P1 with bubble", "first of mixed", "last of mixed", "MINI"))
def test_other_spaces(cell, name):
    """Nodes and areas are those of P1; unknowns are those of the given space."""
    msh, facets = wavy(cell)
    V = spaces(msh)[name]
    surface, reference = qs.Surface(V, facets=facets), qs.Surface(vector_space(msh), facets=facets)
    tables = []
    for s in (surface, reference):
        table = gathered(WORLD, np.column_stack([s.node_x, s.node_area]))
        tables.append(table[np.lexsort(np.round(table[:, :3], 9).T)])
    # A function made from nodal values has these values at the nodes.
    values = surface.node_x[:, : msh.geometry.dim] ** 2 + 1
    u = surface.function(values)
    ds = ufl.Measure("ds", domain=msh)
    total = fem.assemble_scalar(fem.form(ufl.inner(u, ufl.FacetNormal(msh)) * ds))
    u1 = reference.function(reference.node_x[:, : msh.geometry.dim] ** 2 + 1)
    expected = fem.assemble_scalar(fem.form(ufl.inner(u1, ufl.FacetNormal(msh)) * ds))
    total, expected = WORLD.allreduce(total), WORLD.allreduce(expected)
    np.testing.assert_allclose(*tables, atol=1e-14)
    assert np.isclose(total, expected, rtol=1e-12)


@pytest.mark.parallel
def test_functions_of_nodal_values_know_ghosts():
    msh, facets = wavy("tetrahedron", "scattered")
    surface = qs.Surface(vector_space(msh), facets=facets)
    u = surface.function(surface.node_x + 1.0)
    here = u.x.array.copy()
    u.x.scatter_forward()
    np.testing.assert_array_equal(here, u.x.array)
    assert WORLD.allreduce(np.count_nonzero(here)) >= 3 * WORLD.allreduce(len(surface.node_x))


def test_update_follows_the_mesh():
    msh, facets = wavy("triangle")
    surface = qs.Surface(vector_space(msh), facets=facets)
    area = surface.area
    msh.geometry.x[:] *= 3
    before = surface.area
    surface.update()
    after = surface.area
    assert np.isclose(before, area)
    assert np.isclose(after, 3 * area)


@pytest.mark.parametrize("cell", CELLS)
def test_update_is_a_new_surface(cell):
    """An update equals a new surface bit by bit, also where a reflection reverses the facets."""
    msh, facets = wavy(cell, "scattered")
    updated = qs.Surface(vector_space(msh), facets=facets)
    x = msh.geometry.x
    x[:, 0] *= -1.5
    x[:, 1] += 0.3 * np.sin(2 * x[:, 0])
    updated.update()
    new = qs.Surface(updated.V, facets=facets)
    names = "node_dofs", "node_x", "node_area", "node_normal", "facet_size_range"
    pairs = {name: (getattr(updated, name), getattr(new, name)) for name in names}
    outward = new.node_normal[:, 0]
    for name, (a, b) in pairs.items():
        np.testing.assert_array_equal(a, b, err_msg=name)
    assert (outward < 0).all()  # the face x = 1 is x = -1.5 after the reflection


def test_same_on_any_number_of_ranks():
    """Positions, areas and normals do not depend on the partition."""
    tables = []
    for comm in (WORLD, MPI.COMM_SELF):
        msh, facets = wavy("hexahedron", comm=comm)
        surface = qs.Surface(vector_space(msh), facets=facets)
        table = np.column_stack([surface.node_x, surface.node_area, surface.node_normal])
        table = gathered(comm, table)
        tables.append(table[np.lexsort(np.round(table[:, :3], 9).T)])
    np.testing.assert_allclose(*tables, atol=1e-14)


def test_surfaces_on_some_of_the_ranks():
    """Operations on some of the ranks do not disturb later collective operations."""
    for comm in (MPI.COMM_SELF, WORLD):
        if comm is WORLD or WORLD.rank == 0:
            msh = box(comm, [3, 3, 3], "tetrahedron", [0, 0, 0], [1, 1, 1])
            surface = qs.Surface(vector_space(msh), facets=plane(msh, 2, 0.0))
    assert np.isclose(surface.area, 1.0)
