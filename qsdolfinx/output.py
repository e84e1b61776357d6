"""Fields for ParaView."""

from __future__ import annotations

import pathlib
import typing

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, io, mesh
from ufl.core.expr import Expr

#: A function, anything of UFL that can be evaluated in the cells, or what returns a new function.
Field = typing.Any


class FieldWriter:
    """Writes fields of one body at several times, to XDMF or, with ADIOS2, to VTX.

    Functions of degree 1 are written at the vertices, other fields at the cells' midpoints unless
    they are given as continuous. A field such as ``lambda: contact.traction("master")`` is called
    for each time. In XDMF
    the mesh is that of the first time, and the field ``displacement`` says where its vertices have
    moved (ParaView: Warp By Vector), unless a field of this name is given, such as the unknown of a
    body in displacements, whose mesh stays; in VTX the mesh moves. VTX has one kind of field per
    file: those of the cells go to a second one, ``NAME_cells.bp``.

    Args:
        filename: Ends in ``.xdmf`` or ``.bp``.
        msh: The mesh.
        fields: Name and function, or UFL expression, of each field.
        continuous: More of them, that have one value at a vertex, such as ``ufl.split(w)[0]``.

    Raises:
        ValueError: If the file name ends in something else, or DOLFINx has no ADIOS2 for VTX.
    """

    def __init__(
        self,
        filename: str | pathlib.Path,
        msh: mesh.Mesh,
        fields: typing.Mapping[str, Field],
        continuous: typing.Mapping[str, Field] | None = None,
    ) -> None:
        path = pathlib.Path(filename)
        if path.suffix not in (".xdmf", ".bp"):
            raise ValueError(f"filename: must end in .xdmf or .bp, not {path.name!r}")
        if path.suffix == ".bp" and not hasattr(io, "VTXWriter"):
            raise ValueError("filename: this DOLFINx has no ADIOS2 for VTX; use .xdmf")
        self._msh = msh
        self._x0: npt.NDArray[np.float64] = np.array(msh.geometry.x, dtype=np.float64)
        self._points: list[tuple[fem.Function, Field]] = []
        self._cells: list[tuple[fem.Function, Field]] = []
        for name, field in fields.items():
            self._add(name, field, at_vertices=False)
        for name, field in (continuous or {}).items():
            self._add(name, field, at_vertices=True)
        self._xdmf = self._vtx = None
        if path.suffix == ".xdmf":
            vector = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
            self._displacement = (
                None if "displacement" in fields else fem.Function(vector, name="displacement")
            )
            self._xdmf = io.XDMFFile(msh.comm, str(path), "w")
            self._xdmf.write_mesh(msh)
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

    def _add(self, name: str, field: Field, at_vertices: bool) -> None:
        first = field() if _is_source(field) else field
        linear = isinstance(first, fem.Function) and _is_linear(first.function_space)
        element = ("Lagrange", 1) if at_vertices or linear else ("DG", 0)
        space = fem.functionspace(self._msh, (*element, first.ufl_shape))
        written = self._points if at_vertices or linear else self._cells
        if not linear and not _is_source(field):
            field = _expression(field, space)
        written.append((fem.Function(space, name=name), field))

    def write(self, t: float) -> None:
        """Write all fields at time t. Collective."""
        for function, field in (*self._points, *self._cells):
            if _is_source(field):
                field = _expression(field(), function.function_space)
            function.interpolate(field)
        if self._vtx is not None:
            for writer in self._vtx:
                writer.write(t)
            return
        assert self._xdmf is not None
        functions = [function for function, _ in (*self._points, *self._cells)]
        if self._displacement is not None:
            # The file has the first mesh: the displacement is written as a function on it.
            x = np.asarray(self._msh.geometry.x, dtype=np.float64)
            _set_at_vertices(self._displacement, (x - self._x0)[:, : self._msh.geometry.dim])
            functions.insert(0, self._displacement)
        for function in functions:
            self._xdmf.write_function(function, t)

    def close(self) -> None:
        """Close the files. Collective."""
        for writer in (self._xdmf, *(self._vtx or [])):
            if writer is not None:
                writer.close()


def _is_source(field: Field) -> bool:
    """Whether it is to be called for the function; those of UFL can be called, too."""
    return callable(field) and not isinstance(field, fem.Expression | fem.Function | Expr)


def _expression(field: Field, space: fem.FunctionSpace) -> fem.Expression:
    points = space.element.interpolation_points
    return fem.Expression(field, points() if callable(points) else points)


def _is_linear(V: fem.FunctionSpace) -> bool:
    element = V.element.basix_element if not V.num_sub_spaces else V.sub(0).element.basix_element
    return bool(element.family == basix.ElementFamily.P and element.degree == 1) and not bool(
        element.discontinuous
    )


def _set_at_vertices(u: fem.Function, values: npt.NDArray[np.float64]) -> None:
    """Set a P1 or Q1 function to values at the geometry nodes."""
    V = u.function_space
    layout = V.mesh.geometry.cmap.create_dof_layout()
    count = V.dofmap.list.shape[1]
    places = [layout.entity_dofs(0, v)[0] for v in range(count)]
    nodes = V.mesh.geometry.dofmap[:, places]
    own = [V.dofmap.dof_layout.entity_dofs(0, v)[0] for v in range(count)]
    u.x.array.reshape(-1, V.mesh.geometry.dim)[V.dofmap.list[:, own]] = values[nodes]
