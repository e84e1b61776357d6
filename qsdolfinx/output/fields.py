"""Output of fields for ParaView."""

from __future__ import annotations

import ctypes
import pathlib
import typing

import numpy as np
import numpy.typing as npt

import basix
import ufl
from dolfinx import fem, io, mesh
from ufl.core.expr import Expr

from qsdolfinx.base.checks import FINITE, MAPPING, MESH, check, check_file, either, require
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.compat import cell_nodes, coordinate_element, interpolation_points
from qsdolfinx.output import vtkhdf
from qsdolfinx.surface.unknowns import is_lagrange

#: A function, a UFL expression that can be evaluated in the cells, or a callable that returns a new
#: function.
Field = typing.Any


class FieldWriter:
    """Writes fields of one body at several times to XDMF, VTK, VTX (needs ADIOS2) or VTK-HDF.

    Functions of continuous spaces are written at the vertices (on a curved mesh, with geometry of
    degree 2, at its nodes), other fields at the midpoints of cells unless they are given as
    ``continuous``. A field that is a function, such as ``lambda: contact.traction("master")``, is
    called for each time.

    - XDMF (``.xdmf``) has the mesh of the first time. A field ``displacement`` with the motion of
      its nodes is added (ParaView: Warp By Vector), unless a field of this name is given, such as
      the unknown of a displacement-based body, whose mesh does not move.
    - VTK (``.pvd``, with a ``.vtu`` text file for each time and rank) can be read by any VTK
      program. The mesh moves, and may be replaced by another mesh, see :meth:`change_mesh`.
    - VTX (``.bp``) has a moving mesh, and one kind of field per file: fields of the cells are in a
      second file, ``NAME_cells.bp``.
    - VTK-HDF (``.vtkhdf``, if DOLFINx supports it) has one file per field,
      ``NAME_FIELD.vtkhdf``, and the mesh of the first time.

    Args:
        filename: File name that ends in ``.xdmf``, ``.pvd``, ``.bp`` or ``.vtkhdf``.
        msh: The mesh.
        fields: Name and function, or UFL expression, of each field.
        continuous: More fields, UFL expressions that are continuous, such as ``ufl.split(w)[0]``.

    Raises:
        ValueError: If the file name ends in something else, DOLFINx has no ADIOS2 for VTX, or a
            field is on another mesh.
        TypeError: If an argument is of another type.
        OSError: If the folder is missing.
    """

    def __init__(
        self,
        filename: str | pathlib.Path,
        msh: mesh.Mesh,
        fields: typing.Mapping[str, Field],
        continuous: typing.Mapping[str, Field] | None = None,
    ) -> None:
        check(MESH, msh=msh)
        with checked(msh.comm) as same:
            path = check_file("filename", filename)
            _check_suffix(path, msh)
            check(MAPPING, fields=fields)
            check(either(MAPPING, None), continuous=continuous)
            _check_fields("fields", fields, msh)
            _check_fields("continuous", continuous or {}, msh)
            same(filename=str(path), fields=list(fields), continuous=list(continuous or {}))
        self._path = path
        self._take(msh, fields, continuous or {})
        self._xdmf = self._vtk = None
        self._vtx: list[typing.Any] | None = None
        if path.suffix == ".pvd":
            self._vtk = io.VTKFile(msh.comm, str(path), "w")
        elif path.suffix == ".xdmf":
            vector = fem.functionspace(msh, ("Lagrange", self._degree, (msh.geometry.dim,)))
            self._displacement = (
                None if "displacement" in fields else fem.Function(vector, name="displacement")
            )
            self._xdmf = io.XDMFFile(msh.comm, str(path), "w")
            self._xdmf.write_mesh(msh)
        elif path.suffix == ".vtkhdf":
            self._vtx = [
                vtkhdf.VTKHDFWriter(path.with_name(f"{path.stem}_{function.name}.vtkhdf"), function)
                for function, _ in (*self._points, *self._cells)
            ]
        else:
            self._vtx = [
                io.VTXWriter(
                    msh.comm,
                    str(path.with_name(path.stem + suffix)),
                    [function for function, _ in functions],
                    engine="BP4",
                    mesh_policy=io.VTXMeshPolicy.update,
                )
                for suffix, functions in ((".bp", self._points), ("_cells.bp", self._cells))
                if functions
            ]

    def _take(
        self,
        msh: mesh.Mesh,
        fields: typing.Mapping[str, Field],
        continuous: typing.Mapping[str, Field],
    ) -> None:
        """Create the functions that are written, from the fields on a mesh. Collective."""
        self._msh = msh
        self._x0: npt.NDArray[np.float64] = np.array(msh.geometry.x, dtype=np.float64)
        self._degree = coordinate_element(msh).degree
        self._points: list[tuple[fem.Function, Field]] = []
        self._cells: list[tuple[fem.Function, Field]] = []
        for name, field in fields.items():
            self._add(name, field, at_vertices=False)
        for name, field in continuous.items():
            self._add(name, field, at_vertices=True)

    def change_mesh(
        self,
        msh: mesh.Mesh,
        fields: typing.Mapping[str, Field],
        continuous: typing.Mapping[str, Field] | None = None,
    ) -> None:
        """Continue with another mesh, such as after a remeshing, and fields on it. Collective.

        Args:
            msh: The new mesh.
            fields: Fields on the new mesh, with the same names as before.
            continuous: Continuous fields on the new mesh, with the same names as before.

        Raises:
            ValueError: If the file is not ``.pvd``, names differ, or a field is on another mesh.
        """
        names = [function.name for function, _ in (*self._points, *self._cells)]
        with checked(self._msh.comm):
            check(MESH, msh=msh)
            format = "filename: only .pvd files can go on with another mesh"
            require(self._path.suffix == ".pvd", format)
            check(MAPPING, fields=fields)
            check(either(MAPPING, None), continuous=continuous)
            given = [*fields, *(continuous or {})]
            require(sorted(given) == sorted(names), f"fields: must be those before, {names}")
            _check_fields("fields", fields, msh)
            _check_fields("continuous", continuous or {}, msh)
        self._take(msh, fields, continuous or {})

    def _add(self, name: str, field: Field, at_vertices: bool) -> None:
        first = self._made(field) if _is_source(field) else field
        linear = isinstance(first, fem.Function) and is_lagrange(first.function_space, self._degree)
        at_vertices = at_vertices or linear or _is_continuous(first)
        element = ("Lagrange", self._degree) if at_vertices else ("DG", 0)
        space = fem.functionspace(self._msh, (*element, first.ufl_shape))
        written = self._points if at_vertices else self._cells
        if not linear and not _is_source(field):
            field = _expression(field, space)
        written.append((fem.Function(space, name=name), field))

    def _made(self, source: typing.Callable[[], Field]) -> Field:
        """Result of a source; an exception on one rank is raised on all ranks."""
        with collective_errors(self._msh.comm):
            return source()

    def write(self, t: float) -> None:
        """Write all fields at time t. Collective.

        Raises:
            ValueError: If t is not a finite number, or differs between ranks.
            OSError: If the file cannot be written; nothing more can be written to it then.
        """
        with checked(self._msh.comm) as same:
            same(FINITE, t=t)
        for function, field in (*self._points, *self._cells):
            if _is_source(field):
                field = _expression(self._made(field), function.function_space)
            function.interpolate(field)
        if self._vtx is not None:
            for writer in self._vtx:
                writer.write(t)
            return
        if self._vtk is not None:
            self._vtk.write_function([f for f, _ in (*self._points, *self._cells)], t)
            return
        if self._xdmf is None:
            raise OSError(f"filename: {self._path} has been closed, or could not be written before")
        functions = [function for function, _ in (*self._points, *self._cells)]
        if self._displacement is not None:
            # The file has the first mesh: the displacement is written as a function on it.
            x = np.asarray(self._msh.geometry.x, dtype=np.float64)
            _set_at_nodes(self._displacement, (x - self._x0)[:, : self._msh.geometry.dim])
            functions.insert(0, self._displacement)
        for function in functions:
            try:
                with collective_errors(self._msh.comm):
                    self._xdmf.write_function(function, t)
            except RuntimeError as error:
                self._abandon()
                raise OSError(f"filename: {self._path} cannot be written: {error}") from error

    def _abandon(self) -> None:
        """Abandon a file that could not be written.

        Closing or freeing it would abort the program, because DOLFINx has left parts of it open.
        """
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._xdmf))
        self._xdmf, self._vtk, self._vtx = None, None, []

    def __enter__(self) -> FieldWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; a ``with`` block does this at its end. Collective."""
        for writer in (self._xdmf, self._vtk, *(self._vtx or [])):
            if writer is not None:
                writer.close()
        self._vtk = None


def _check_suffix(path: pathlib.Path, msh: mesh.Mesh) -> None:
    """Raise an error for unknown formats, or formats in which DOLFINx cannot write the mesh."""
    known = path.suffix in (".xdmf", ".pvd", ".bp", ".vtkhdf")
    require(known, f"filename: must end in .xdmf, .pvd, .bp or .vtkhdf, not {path.name!r}")
    if path.suffix == ".vtkhdf":
        require(vtkhdf.module, "filename: this DOLFINx has no VTK-HDF; use .xdmf or .bp")
        straight = coordinate_element(msh).degree == 1
        require(straight, "filename: VTK-HDF does not support curved meshes; use .xdmf or .bp")
    has_vtx = path.suffix != ".bp" or hasattr(io, "VTXWriter")
    require(has_vtx, "filename: this DOLFINx has no ADIOS2 for VTX; use .xdmf")


def _check_fields(argument: str, fields: typing.Mapping[str, Field], msh: mesh.Mesh) -> None:
    """Raise an error for an argument that is not a field, or a Function on another mesh."""
    for name, field in fields.items():
        text = f"{argument}: {name!r} must be a Function, of UFL, or return a Function"
        require(callable(field) or hasattr(field, "ufl_shape"), text, TypeError)
        here = not isinstance(field, fem.Function) or field.function_space.mesh is msh
        require(here, f"{argument}: {name!r} is on another mesh")


def _is_source(field: Field) -> bool:
    """Whether the field must be called to get the function; UFL expressions are callable, too."""
    return callable(field) and not isinstance(field, fem.Expression | fem.Function | Expr)


def _is_continuous(field: Field) -> bool:
    """Whether the field is a function of a space in H¹, such as Lagrange of any degree."""
    return isinstance(field, fem.Function) and field.function_space.ufl_element() in ufl.H1


def _expression(field: Field, space: fem.FunctionSpace) -> fem.Expression:
    return fem.Expression(field, interpolation_points(space))


def _set_at_nodes(u: fem.Function, values: npt.NDArray[np.float64]) -> None:
    """Set a Lagrange function of the geometry's degree to values at the geometry nodes."""
    V = u.function_space
    layout, own = coordinate_element(V.mesh).create_dof_layout(), V.dofmap.dof_layout
    cell = basix.topology(getattr(basix.CellType, V.mesh.topology.cell_type.name))
    both = [
        (layout.entity_dofs(dim, i), own.entity_dofs(dim, i))
        for dim, entities in enumerate(cell)
        for i in range(len(entities))
    ]
    there, here = (np.concatenate(places).astype(np.int32) for places in zip(*both, strict=True))
    nodes = cell_nodes(V.mesh)[:, there]
    u.x.array.reshape(-1, V.mesh.geometry.dim)[V.dofmap.list[:, here]] = values[nodes]
