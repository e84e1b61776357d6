"""Transfer of fields from an old mesh to a new mesh."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from qsdolfinx.base.checks import FLAG, FUNCTION, POSITIVE, check, either, instance, require
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.compat import cell_nodes
from qsdolfinx.remeshing.bounded import is_of_points, project
from qsdolfinx.remeshing.sizes import where

Array = npt.NDArray[np.float64]

#: Shift of a mesh, over its largest cell, and its direction, which is parallel to no face of a
#: usual mesh. Values change by as much; with less than 1e-9, DOLFINx would not see it.
ASIDE, _SOMEWHERE = 1e-6, np.array([0.53, 0.71, 0.46])

SPACE = instance(fem.FunctionSpace, "a dolfinx.fem.FunctionSpace")


def transfer(
    function: fem.Function,
    V_new: fem.FunctionSpace,
    *,
    displacement: fem.Function | None = None,
    reach: float | None = None,
    axisymmetric: bool = False,
) -> fem.Function:
    """Transfer a function to another mesh of the same body. Collective.

    Functions of Lagrange and enriched elements, and of mixed and vector elements of these, are
    interpolated: for degree 1 the error falls with h². At a point outside of all old cells, as
    beside a curved boundary, the polynomial of the closest cell is extrapolated.

    Functions with values in cells (DG0) or at quadrature points are projected cell by cell. The new
    values stay between the smallest and the largest value of the old cells that contain the new
    cell or point and of the cells around them. Integrals of each component are kept to 1e-12 as far
    as these bounds allow.

    Args:
        function: Function on the old mesh.
        V_new: Space on the new mesh, of the same kind: either both spaces have values in cells or
            points, or none has; mixed spaces have the same parts.
        displacement: Displacement from the old mesh to the new mesh. By default none: the meshes
            are at the same position.
        reach: Largest distance of a point from all old cells (length); by default the largest size
            of an old cell.
        axisymmetric: Whether coordinates are (r, z), and integrals are over rings.

    Returns:
        The function in ``V_new``.

    Raises:
        ValueError: If spaces are of different kinds or shapes, or a point is further away than
            ``reach``.
        TypeError: If an argument is of another type.
    """
    check(FUNCTION, function=function)
    comm = function.function_space.mesh.comm
    with checked(comm) as same:
        check(SPACE, V_new=V_new)
        check(either(FUNCTION, None), displacement=displacement)
        same(either(POSITIVE, None), reach=reach)
        same(FLAG, axisymmetric=axisymmetric)
        finite = bool(np.isfinite(function.x.array).all())
        require(finite, "function: must have finite values (no NaN, no infinity)")
        alike = function.ufl_shape == V_new.value_shape
        require(alike, "V_new: must have as many components as the function")
        alike = is_of_points(function.function_space) == is_of_points(V_new)
        require(alike, "V_new: both spaces or none must have values in cells or points")
        parts = _num_parts(function.function_space), _num_parts(V_new)
        require(parts[0] == parts[1], "V_new: must have the same parts as the function's space")
        on_old = displacement is None or displacement.function_space.mesh is _mesh_of(function)
        require(on_old, "displacement: must be on the mesh of the function")
    out = fem.Function(V_new, name=function.name)
    with _displaced(_mesh_of(function), displacement):
        distance = _largest_cell(_mesh_of(function)) if reach is None else float(reach)
        _transfer(function, out, distance, axisymmetric)
    return out


def _mesh_of(function: fem.Function) -> mesh.Mesh:
    return function.function_space.mesh


def _num_parts(V: fem.FunctionSpace) -> int:
    """Number of sub-spaces of a mixed space, 0 for another space."""
    return 0 if V.dofmap.dof_layout.block_size > 1 else int(V.num_sub_spaces)


def _transfer(function: fem.Function, out: fem.Function, reach: float, axisymmetric: bool) -> None:
    """Write the function to the function on the other mesh. Collective."""
    V, V_new = function.function_space, out.function_space
    for i in range(_num_parts(V)):
        part, places = V_new.sub(i).collapse()
        found = fem.Function(part)
        _transfer(function.sub(i).collapse(), found, reach, axisymmetric)
        out.x.array[np.ravel(places)] = found.x.array
    if _num_parts(V):
        return
    search = Search(V.mesh, V_new.mesh, reach)

    def interpolate(old: fem.Function, new: fem.Function) -> None:
        with _aside(V.mesh, V_new.mesh) as scale:
            search.interpolate(old, new, scale)

    if is_of_points(V):
        project(function, out, interpolate, axisymmetric)
    else:
        search.interpolate(function, out)


@contextlib.contextmanager
def _displaced(msh: mesh.Mesh, displacement: fem.Function | None) -> typing.Iterator[None]:
    """Move the mesh by the displacement, inside the block."""
    if displacement is None:
        yield
        return
    before = msh.geometry.x.copy()
    msh.geometry.x[:] = where(displacement)[1]
    try:
        yield
    finally:
        msh.geometry.x[:] = before


@contextlib.contextmanager
def _aside(old: mesh.Mesh, new: mesh.Mesh) -> typing.Iterator[float]:
    """Magnify both meshes, and shift the old one slightly, inside the block.

    Otherwise a point of the new mesh on a face between two old cells would use the values of the
    cell that is found first, which depends on the partition. DOLFINx takes points within 1e-6, in
    any unit, as points of a cell: the largest cell is made so large that this is little of the
    shift.
    """
    size = 1e3
    before, scale = (old.geometry.x.copy(), new.geometry.x.copy()), size / _largest_cell(old)
    shift = np.where(np.arange(3) < old.geometry.dim, _SOMEWHERE, 0.0)
    old.geometry.x[:] = scale * before[0] + ASIDE * size * shift
    new.geometry.x[:] = scale * before[1]
    try:
        yield scale
    finally:
        old.geometry.x[:], new.geometry.x[:] = before


def _largest_cell(msh: mesh.Mesh) -> float:
    """Largest distance between two nodes of a cell. Collective."""
    x = msh.geometry.x[cell_nodes(msh)]
    pairs = np.linalg.norm(x[:, :, None] - x[:, None], axis=-1)
    return float(msh.comm.allreduce(pairs.max(initial=0.0), op=MPI.MAX))


class Search:
    """Find the positions of points of one mesh in another mesh.

    Args:
        old: Mesh of the fields.
        new: Mesh to which the fields are transferred.
        reach: Largest distance of a point from all cells (length).
    """

    def __init__(self, old: mesh.Mesh, new: mesh.Mesh, reach: float) -> None:
        self._old, self._new, self._reach = old, new, reach
        index_map = new.topology.index_map(new.topology.dim)
        count = index_map.size_local + index_map.num_ghosts
        self._cells = np.arange(count, dtype=np.int32)
        x = old.geometry.x
        mine = float(np.ptp(x, axis=0).max()) if len(x) else 0.0  # a rank may have no cells
        size = float(new.comm.allreduce(mine, op=MPI.MAX))
        self._paddings = [ROUNDING * size, min(0.02 * reach, reach), reach]

    def interpolate(self, function: fem.Function, out: fem.Function, scale: float = 1.0) -> None:
        """Interpolate a function on the old mesh into one on the new mesh. Collective.

        Args:
            function: On the old mesh.
            out: On the new mesh.
            scale: Magnification of both meshes.

        Raises:
            ValueError: If a point is out of reach.
        """
        V, V_new = function.function_space, out.function_space
        shape = function.ufl_shape
        one = fem.Function(fem.functionspace(self._old, ("Lagrange", 1, shape)))
        one.x.array[:] = 1.0
        number = max(int(np.prod(shape)), 1)
        expected, found = fem.Function(V_new), fem.Function(V_new)
        expected.interpolate(
            lambda x: np.ones((number, x.shape[1])) if shape else np.ones(x.shape[1])
        )
        for padding in self._paddings:
            padding *= scale
            data = fem.create_interpolation_data(V_new, V, self._cells, padding=padding)
            found.x.array[:] = 0.0
            found.interpolate_nonmatching(one, self._cells, data)
            lost = np.abs(found.x.array - expected.x.array) > SOLVED
            if not V_new.mesh.comm.allreduce(bool(lost.any()), op=MPI.LOR):
                break
        else:
            self._refuse(V_new, lost)
        out.interpolate_nonmatching(function, self._cells, data)
        out.x.scatter_forward()

    def _refuse(self, V: fem.FunctionSpace, lost: npt.NDArray[np.bool_]) -> None:
        bs = V.dofmap.index_map_bs
        cells = np.flatnonzero(np.any(lost.reshape(-1, bs)[V.dofmap.list], axis=(1, 2)))
        with collective_errors(V.mesh.comm):
            if len(cells):
                x = V.mesh.geometry.x[cell_nodes(V.mesh)[cells]].mean(axis=1)
                at = "({:.5g}, {:.5g}, {:.5g})".format(*x[0])
                raise ValueError(
                    f"V_new: {len(cells)} cells have points that are further than reach = "
                    f"{self._reach:.3g} from the old mesh, as near {at}: is it the same body?"
                )
