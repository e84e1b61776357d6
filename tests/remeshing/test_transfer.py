"""Transfer of fields to another mesh: rates, bounds, integrals."""

from mpi4py import MPI

import numpy as np
import pytest
from remeshing_scenes import integral, points_element
from scenes import WORLD

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs


def smooth(x):
    return np.sin(2 * x[0]) * np.exp(x[1])


def exact(msh):
    x = ufl.SpatialCoordinate(msh)
    return ufl.sin(2 * x[0]) * ufl.exp(x[1])


def two(dim, n):
    """Two meshes of the same body that have no nodes or cells in common."""
    create = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    first, second = (create(WORLD, *([k] * dim)) for k in (3 * n, 4 * n + 1))
    x = second.geometry.x
    x[:, 0] += 0.1 / n * np.prod(np.sin(np.pi * x[:, :dim]), axis=1)
    return first, second


def moved(msh, V, function):
    """The function transferred to another mesh, and its L2 error there."""
    found = qs.transfer(function, V)
    return found, np.sqrt(integral((found - exact(msh)) ** 2 * ufl.dx))


@pytest.mark.parametrize("dim", [2, 3])
def test_degree_1_is_of_order_2(dim):
    errors = []
    for n in (2, 4):
        old, new = two(dim, n)
        f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
        f.interpolate(smooth)
        errors.append(moved(new, fem.functionspace(new, ("Lagrange", 1)), f)[1])
    assert np.log2(errors[0] / errors[1]) > 1.8


@pytest.mark.parametrize("dim", [2, 3])
def test_mixed_spaces_keep_what_is_linear(dim):
    old, new = two(dim, 2)
    w = fem.Function(qs.materials.mini_space(old))
    w.sub(0).interpolate(lambda x: x[:dim] + x[:1])
    w.sub(1).interpolate(lambda x: 2 - x[1])
    found = qs.transfer(w, qs.materials.mini_space(new))
    x = ufl.SpatialCoordinate(new)
    wrong = found.sub(0) - x - x[0] * ufl.as_vector([1.0] * dim), found.sub(1) - 2 + x[1]
    assert integral(ufl.inner(wrong[0], wrong[0]) * ufl.dx + wrong[1] ** 2 * ufl.dx) < 1e-20


@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_at_rest_changes_by_interpolation_alone(dim):
    """Remeshing with the old size changes a field by O(h²), its interpolation error."""
    pytest.importorskip("gmsh")
    errors, counts = [], []
    for n in (3, 6) if dim == 3 else (5, 10):
        old = (mesh.create_unit_square if dim == 2 else mesh.create_unit_cube)(WORLD, *([n] * dim))
        f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
        f.interpolate(smooth)
        new, _, report = qs.remesh(old, 1 / n)
        assert abs(report.volume_change) < 1e-12 and report.shift == 0
        errors.append(moved(new, fem.functionspace(new, ("Lagrange", 1)), f)[1])
        counts.append(report.num_cells)  # h⁻² in 2D and h⁻³ in 3D
    assert dim * np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0]) > 1.7


def elements(msh, kind, shape=()):
    if kind == "cells":
        return basix.ufl.element("DG", msh.basix_cell(), 0, shape=shape)
    return points_element(msh, shape=shape)


def of_points(msh, kind):
    """Measure that integrates over the points of a space with point values."""
    metadata = {"quadrature_degree": 2, "quadrature_scheme": "default"}
    return ufl.Measure("dx", domain=msh, metadata=metadata)


@pytest.mark.parametrize("kind", ["cells", "points"])
@pytest.mark.parametrize("dim", [2, 3])
def test_values_in_cells_stay_in_bounds_and_keep_integrals(dim, kind):
    errors = []
    for n in (2, 4):
        old, new = two(dim, n)
        f = fem.Function(fem.functionspace(old, elements(old, kind)))
        f.interpolate(smooth)
        found = qs.transfer(f, fem.functionspace(new, elements(new, kind)))
        low, high = (
            [WORLD.allreduce(reduce(g.x.array), op=op) for g in (f, found)]
            for reduce, op in ((np.min, MPI.MIN), (np.max, MPI.MAX))
        )
        assert low[1] >= low[0] - 1e-14 and high[1] <= high[0] + 1e-14
        kept = integral(f * of_points(old, kind)), integral(found * of_points(new, kind))
        assert np.isclose(*kept, rtol=1e-12)
        errors.append(np.sqrt(integral((found - exact(new)) ** 2 * of_points(new, kind))))
    order = {"cells": 0.9, "points": 1.5}[kind]
    assert np.log2(errors[0] / errors[1]) > order


@pytest.mark.parametrize("kind", ["cells", "points"])
def test_a_jump_makes_no_overshoots(kind):
    old, new = two(2, 3)
    f = fem.Function(fem.functionspace(old, elements(old, kind)))
    f.interpolate(lambda x: np.where(x[0] + 0.3 * x[1] < 0.6, 1.0, 3.0))
    values = qs.transfer(f, fem.functionspace(new, elements(new, kind))).x.array
    assert np.all((values >= 1 - 1e-14) & (values <= 3 + 1e-14))
    assert integral(f * of_points(old, kind)) > 1


@pytest.mark.parametrize("kind", ["cells", "points"])
def test_each_component_of_a_tensor_and_rings(kind):
    """The integral over rings is kept for each component of a tensor."""
    old, new = two(2, 3)
    f = fem.Function(fem.functionspace(old, elements(old, kind, (2, 2))))
    f.interpolate(lambda x: np.stack([smooth(x), x[0], x[1] ** 2, 1 + 0 * x[0]]))
    V = fem.functionspace(new, elements(new, kind, (2, 2)))
    found = qs.transfer(f, V, axisymmetric=True)

    def over_rings(g, msh):
        r = ufl.SpatialCoordinate(msh)[0]
        return [integral(g[i, j] * r * of_points(msh, kind)) for i in (0, 1) for j in (0, 1)]

    assert np.allclose(over_rings(found, new), over_rings(f, old), rtol=1e-11)


def test_points_beside_the_old_mesh_continue_its_cells():
    """Values at points outside the old mesh are extrapolated from its cells.

    The old boundary has chords where the new boundary is an arc.
    """
    old, new = mesh.create_unit_square(WORLD, 4, 4), mesh.create_unit_square(WORLD, 11, 11)
    for msh in (old, new):
        x = msh.geometry.x
        x[:, 1] += 0.2 * x[:, 1] * np.sin(np.pi * x[:, 0])
    f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
    f.interpolate(lambda x: 1 + x[0] - 2 * x[1])
    found = qs.transfer(f, fem.functionspace(new, ("Lagrange", 1)))
    x = found.function_space.tabulate_dof_coordinates()
    assert np.allclose(found.x.array, 1 + x[:, 0] - 2 * x[:, 1])


def test_a_displaced_source():
    old, new = mesh.create_unit_square(WORLD, 4, 5), mesh.create_unit_square(WORLD, 7, 6)
    new.geometry.x[:, 0] = 3 + 2 * new.geometry.x[:, 0]
    u = fem.Function(fem.functionspace(old, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.stack([3 + x[0], 0 * x[0]]))
    f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
    f.interpolate(lambda x: x[0])
    before = old.geometry.x.copy()
    found = qs.transfer(f, fem.functionspace(new, ("Lagrange", 1)), displacement=u)
    x = found.function_space.tabulate_dof_coordinates()
    assert np.allclose(found.x.array, (x[:, 0] - 3) / 2)
    assert np.array_equal(old.geometry.x, before)


def test_another_body_is_refused():
    old, new = mesh.create_unit_square(WORLD, 4, 4), mesh.create_unit_square(WORLD, 4, 4)
    new.geometry.x[:, 0] += 0.5
    f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
    with pytest.raises(ValueError, match=r"further than reach = 0.1 .* is it the same body"):
        qs.transfer(f, fem.functionspace(new, ("Lagrange", 1)), reach=0.1)


def test_spaces_of_another_kind_are_refused():
    old, new = two(2, 1)
    f = fem.Function(fem.functionspace(old, ("Lagrange", 1)))
    for space, text in ((("DG", 0), "both spaces or none"), (("Lagrange", 1, (2,)), "components")):
        with pytest.raises(ValueError, match=text):
            qs.transfer(f, fem.functionspace(new, space))


@pytest.mark.parallel
def test_cells_on_any_number_of_ranks():
    """Points on faces between old cells get the same values on any partition."""
    found = []
    for comm in (MPI.COMM_SELF, WORLD):
        msh = mesh.create_box(comm, [[0.0] * 3, [1.0] * 3], [5, 5, 5])
        new = qs.remesh(msh, 0.2).mesh
        old = fem.Function(fem.functionspace(msh, ("DG", 0)))
        old.interpolate(lambda x: 5.0 * (x[0] > 0.79) + x[1] + 0.3 * x[2])
        out = qs.transfer(old, fem.functionspace(new, ("DG", 0)))
        count = new.topology.index_map(3).size_local
        middle = mesh.compute_midpoints(new, 3, np.arange(count, dtype=np.int32))
        rows = np.concatenate(comm.allgather(np.column_stack([middle, out.x.array[:count]])))
        found.append(rows[np.lexsort(np.round(rows[:, :3], 9).T)])
    np.testing.assert_allclose(found[1], found[0], atol=1e-11)


def test_large_cells_have_the_means_of_small_ones():
    """One value in the middle of each large cell would be wrong where the function is curved."""
    old = mesh.create_unit_square(WORLD, 32, 32)
    new = mesh.create_unit_square(WORLD, 2, 2)
    f = fem.Function(fem.functionspace(old, ("DG", 0)))
    f.interpolate(lambda x: x[0] ** 3)
    V = fem.functionspace(new, ("DG", 0))
    found = qs.transfer(f, V).x.array[: V.dofmap.index_map.size_local]
    x, v = ufl.SpatialCoordinate(new), ufl.TestFunction(V)
    sums = [fem.assemble_vector(fem.form(g * v * ufl.dx(degree=3))) for g in (x[0] ** 3, 1.0)]
    for each in sums:
        each.scatter_reverse(la.InsertMode.add)
    mean = (sums[0].array / sums[1].array)[: len(found)]
    np.testing.assert_allclose(found, mean, atol=5e-3)
