"""Test that the functions of qsdolfinx.compat do what their names say in every DOLFINx version."""

import gmsh
import numpy as np
import pytest
from scenes import CELLS, WORLD, box

import basix.ufl
import ufl
from dolfinx import fem, mesh

from qsdolfinx import compat

#: Number of unknowns inside a vertex, edge, ... of a cell in a space of degree 2.
QUADRATIC = {
    "triangle": [1, 1, 0],
    "quadrilateral": [1, 1, 1],
    "tetrahedron": [1, 1, 0, 0],
    "hexahedron": [1, 1, 1, 1],
}


def domain(cell):
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    return box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")


@pytest.mark.parametrize("cell", CELLS)
def test_cell_nodes(cell):
    """The mean of a cell's nodes is its midpoint; the dof layout has an entry for each node."""
    msh = domain(cell)
    tdim = msh.topology.dim
    cells = np.arange(msh.topology.index_map(tdim).size_local, dtype=np.int32)
    nodes = compat.cell_nodes(msh)
    midpoints = mesh.compute_midpoints(msh, tdim, cells)
    element = compat.coordinate_element(msh)
    assert element.degree == 1
    assert element.create_dof_layout().num_dofs == nodes.shape[1]
    np.testing.assert_allclose(msh.geometry.x[nodes[cells]].mean(axis=1), midpoints, atol=1e-14)


@pytest.mark.parametrize("cell", CELLS)
def test_num_entity_dofs(cell):
    msh = domain(cell)
    for degree, expected in ((1, [1] + [0] * msh.topology.dim), (2, QUADRATIC[cell])):
        V = fem.functionspace(msh, ("Lagrange", degree, (msh.geometry.dim,)))
        assert [compat.num_entity_dofs(V, d) for d in range(msh.topology.dim + 1)] == expected


@pytest.mark.parametrize("cell", CELLS)
def test_collapse(cell):
    """A function on the whole mesh has the values of the function on the part, ghosts included."""
    msh = domain(cell)
    velocity = basix.ufl.element("Lagrange", msh.basix_cell(), 2, shape=(msh.geometry.dim,))
    pressure = basix.ufl.element("Lagrange", msh.basix_cell(), 1)
    w = fem.Function(fem.functionspace(msh, basix.ufl.mixed_element([velocity, pressure])))
    w.sub(0).interpolate(lambda x: x[: msh.geometry.dim] ** 2)
    w.sub(1).interpolate(lambda x: 1 + x[0] + 2 * x[1])
    w.x.scatter_forward()
    V, places = compat.collapse(w.function_space.sub(0))
    Q, others = compat.collapse(w.function_space.sub(1))
    x, y = V.tabulate_dof_coordinates()[:, : msh.geometry.dim], Q.tabulate_dof_coordinates()
    np.testing.assert_allclose(w.x.array[places], (x**2).ravel(), atol=1e-13)
    np.testing.assert_allclose(w.x.array[others], 1 + y[:, 0] + 2 * y[:, 1], atol=1e-13)
    assert np.array_equal(np.sort(np.concatenate([places, others])), np.arange(len(w.x.array)))


@pytest.mark.parametrize("cell", CELLS)
def test_interpolation_points(cell):
    """A constant per cell has one point, in the middle of the cell; ∫x dx is exact with it."""
    msh = domain(cell)
    V = fem.functionspace(msh, ("DG", 0))
    u = fem.Function(V)
    points = compat.interpolation_points(V)
    assert points.shape == (1, msh.topology.dim)
    u.interpolate(fem.Expression(ufl.SpatialCoordinate(msh)[0], points))
    total = WORLD.allreduce(fem.assemble_scalar(fem.form(u * ufl.dx)))
    assert abs(total - 0.5) < 1e-13


def test_model_to_mesh():
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if WORLD.rank == 0:
        gmsh.model.occ.addDisk(0, 0, 0, 2, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
        gmsh.model.addPhysicalGroup(2, [1], 1)
        gmsh.model.mesh.generate(2)
    msh = compat.model_to_mesh(gmsh.model, WORLD, 0, gdim=2)[0]
    gmsh.finalize()
    one = fem.Constant(msh, 1.0)
    area = WORLD.allreduce(fem.assemble_scalar(fem.form(one * ufl.dx(domain=msh))))
    assert (msh.topology.dim, msh.geometry.dim) == (2, 2)
    assert 0.99 * 2 * np.pi < area < 2 * np.pi


def test_prisms_are_refused():
    """An error names the argument; DOLFINx 0.9 ends with a KeyError on one rank."""
    gmsh.initialize(["", "-v", "0"])
    if WORLD.rank == 0:
        base = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.extrude([(2, base)], 0, 0, 1, numElements=[2], recombine=True)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], 1)
        gmsh.model.mesh.generate(3)
    with pytest.raises(ValueError, match="model: has prisms or pyramids"):
        compat.model_to_mesh(gmsh.model, WORLD)
    gmsh.finalize()
