"""Project values in cells and quadrature points, and keep them within their bounds."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix
import basix.ufl
from dolfinx import fem, mesh

from qsdolfinx.compat import cell_nodes

Array = npt.NDArray[np.float64]
Interpolate = typing.Callable[[fem.Function, fem.Function], None]

#: Degree of the rule by which new cells sample old ones. With 1, old cells smaller than the new
#: ones would be missed.
SAMPLES = 5

#: Relative change of an integral that counts as rounding error: a larger one would remain in the
#: result.
EXACT = 1e-13


def is_of_points(V: fem.FunctionSpace) -> bool:
    """Whether a space holds values in cells or quadrature points."""
    return _is_of_quadrature(V) or _is_of_cells(V)


def _is_of_quadrature(V: fem.FunctionSpace) -> bool:
    return bool(getattr(V.ufl_element(), "has_custom_quadrature", False))


def _is_of_cells(V: fem.FunctionSpace) -> bool:
    element = V.ufl_element()
    return getattr(element, "family_name", "") == "P" and element.degree == 0


def project(
    function: fem.Function, out: fem.Function, interpolate: Interpolate, axisymmetric: bool
) -> None:
    """Project values in cells or points onto those of another mesh. Collective.

    Args:
        function: On the old mesh.
        out: On the new mesh.
        interpolate: Interpolates a function on the old mesh into one on the new mesh.
        axisymmetric: Whether coordinates are (r, z), and integrals are over rings.
    """
    V, V_new = function.function_space, out.function_space
    shape, bs = function.ufl_shape, V.dofmap.index_map_bs
    old = _values(function)
    samples = _sample_space(V_new, shape)
    linear, low, high = (
        _sampled(samples, interpolate, f) for f in (_linear(function), *_bounds(function))
    )
    found = np.clip(linear, low, high)
    weights = _weights(samples, axisymmetric)
    if _is_of_cells(V_new):
        of_cell = weights.sum(axis=1, keepdims=True)
        found = np.sum(weights[..., None] * found, axis=1, keepdims=True) / of_cell[..., None]
        low, high = low.min(axis=1, keepdims=True), high.max(axis=1, keepdims=True)
        weights = of_cell
    goal = _integral(V.mesh, old, _weights(V, axisymmetric))
    found = _with_integral(V_new.mesh, found, low, high, weights, goal)
    out.x.array.reshape(-1, bs)[V_new.dofmap.list] = found
    out.x.scatter_forward()


def _values(function: fem.Function) -> Array:
    """Values in the points of each cell, shape (cells, points, components)."""
    V = function.function_space
    return np.asarray(function.x.array.reshape(-1, V.dofmap.index_map_bs)[V.dofmap.list])


def _rule(V: fem.FunctionSpace) -> tuple[Array, Array]:
    """Points and weights of a space of quadrature points; the middle of the cell of DG0."""
    if _is_of_quadrature(V):
        x, w = V.ufl_element().custom_quadrature()
        return np.asarray(x), np.asarray(w)
    x, w = basix.make_quadrature(_cell(V.mesh), 1)
    return np.asarray(x), np.asarray(w)


def _cell(msh: mesh.Mesh) -> basix.CellType:
    return getattr(basix.CellType, msh.topology.cell_type.name)


def _weights(V: fem.FunctionSpace, axisymmetric: bool) -> Array:
    """Volumes represented by the points of each cell, shape (cells, points).

    Axisymmetric: times the radius, over 2π. Cells are simplices.
    """
    points, weights = _rule(V)
    x = V.mesh.geometry.x[cell_nodes(V.mesh)]
    gdim = V.mesh.geometry.dim
    jacobian = np.abs(np.linalg.det((x[:, 1:] - x[:, :1])[..., :gdim]))
    out = jacobian[:, None] * weights[None]
    if not axisymmetric:
        return np.asarray(out)
    if len(points) == 1:  # DG0: ∫ r over the cell, exact with the radius of the middle
        return np.asarray(out * x[:, :, 0].mean(axis=1)[:, None])
    barycentric = np.column_stack([1 - points.sum(axis=1), points])
    return np.asarray(out * (x[:, :, 0] @ barycentric.T))


def _sample_space(V: fem.FunctionSpace, shape: tuple[int, ...]) -> fem.FunctionSpace:
    """Quadrature points at which new cells sample the old ones: their own, if they have any."""
    if _is_of_quadrature(V):
        return V
    element = basix.ufl.quadrature_element(V.mesh.basix_cell(), value_shape=shape, degree=SAMPLES)
    return fem.functionspace(V.mesh, element)


def _sampled(V: fem.FunctionSpace, interpolate: Interpolate, function: fem.Function) -> Array:
    out = fem.Function(V)
    interpolate(function, out)
    return _values(out)


def _linear(function: fem.Function) -> fem.Function:
    """Best linear fit of the values in each cell; DG0 values are unchanged."""
    V = function.function_space
    points, weights = _rule(V)
    tdim = V.mesh.topology.dim
    if len(points) <= tdim:
        return _piecewise(V, 0, np.mean(_values(function), axis=1, keepdims=True))
    element = basix.create_element(
        basix.ElementFamily.P, _cell(V.mesh), 1, basix.LagrangeVariant.gll_warped
    )
    N = np.asarray(element.tabulate(0, points))[0, :, :, 0]
    fit = np.linalg.solve(N.T @ (weights[:, None] * N), N.T * weights)
    return _piecewise(V, 1, np.einsum("np,cpi->cni", fit, _values(function)))


def _bounds(function: fem.Function) -> tuple[fem.Function, fem.Function]:
    """Smallest and largest values of each cell and its neighbours. Collective."""
    V, values = function.function_space, _values(function)
    vertices = fem.functionspace(V.mesh, ("Lagrange", 1)).dofmap
    largest = _largest_around(vertices, values.max(axis=1))
    least = -_largest_around(vertices, -values.min(axis=1))
    return _piecewise(V, 0, least[:, None]), _piecewise(V, 0, largest[:, None])


def _largest_around(vertices: fem.DofMap, of_cells: Array) -> Array:
    """Largest values of each cell and its neighbours, shape (cells, components). Collective."""
    index_map, cells = vertices.index_map, vertices.list
    owned, every = index_map.size_local, index_map.size_local + index_map.num_ghosts
    vec = PETSc.Vec().createGhost(
        index_map.ghosts.astype(PETSc.IntType), (owned, index_map.size_global), comm=index_map.comm
    )
    out = np.empty_like(of_cells)
    for i in range(of_cells.shape[1]):
        at_vertices = np.full(every, -np.inf)
        np.maximum.at(at_vertices, cells, of_cells[:, i : i + 1])
        with vec.localForm() as local:
            local.array[:] = at_vertices
        vec.ghostUpdate(PETSc.InsertMode.MAX_VALUES, PETSc.ScatterMode.REVERSE)
        vec.ghostUpdate(PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        with vec.localForm() as local:
            out[:, i] = local.array_r[cells].max(axis=1)
    vec.destroy()
    return out


def _piecewise(V: fem.FunctionSpace, degree: int, values: Array) -> fem.Function:
    """Function of a given degree in each cell, from its values at the nodes of the cells."""
    element = basix.ufl.element(
        "Lagrange", V.mesh.basix_cell(), degree, shape=V.value_shape, discontinuous=True
    )
    out = fem.Function(fem.functionspace(V.mesh, element))
    dofs = out.function_space.dofmap.list
    out.x.array.reshape(-1, values.shape[2])[dofs] = values
    return out


def _integral(msh: mesh.Mesh, values: Array, weights: Array) -> Array:
    """Integrals of the components over owned cells of all ranks. Collective."""
    owned = msh.topology.index_map(msh.topology.dim).size_local
    local = np.einsum("cp,cpi->i", weights[:owned], values[:owned])
    return np.asarray(msh.comm.allreduce(local, op=MPI.SUM))


def _with_integral(
    msh: mesh.Mesh, values: Array, low: Array, high: Array, weights: Array, goal: Array
) -> Array:
    """Move all values towards a bound by the same fraction, to reach an integral. Collective."""
    scale = _integral(msh, np.maximum(np.abs(low), np.abs(high)), weights)
    for _ in range(3):  # rounding
        missing = goal - _integral(msh, values, weights)
        if np.all(np.abs(missing) <= EXACT * scale):
            break
        room = np.where(missing > 0, high - values, values - low)
        whole = np.maximum(_integral(msh, room, weights), 1e-300)
        part = np.clip(missing / whole, -1.0, 1.0)
        values = np.clip(values + part * room, low, high)
    return values
