"""Write VTK-HDF files, with DOLFINx 0.10 or later."""

from __future__ import annotations

import pathlib
import typing

import numpy as np

from dolfinx import fem, io, mesh

from qsdolfinx.compat import cell_nodes

#: DOLFINx's module, None if it is older.
module: typing.Any = getattr(io, "vtkhdf", None)
if not all(hasattr(module, name) for name in ("write_mesh", "write_point_data", "write_cell_data")):
    module = None


class VTKHDFWriter:
    """Write one field at several times, on the initial mesh. Collective.

    DOLFINx gives every field of a file the same name, so each field has its own file.

    Args:
        filename: File name that ends in ``.vtkhdf``.
        function: Function, continuous of degree 1 or constant in cells.
    """

    def __init__(self, filename: pathlib.Path, function: fem.Function) -> None:
        self._filename, self._function = str(filename), function
        module.write_mesh(self._filename, function.function_space.mesh)

    def write(self, t: float) -> None:
        """Write the function's values at time t. Collective."""
        V = self._function.function_space
        msh: mesh.Mesh = V.mesh
        values = self._function.x.array.reshape(-1, V.dofmap.bs)
        if V.dofmap.list.shape[1] == 1:
            put, owned = module.write_cell_data, msh.topology.index_map(msh.topology.dim)
            data = values[V.dofmap.list[: owned.size_local, 0]]
        else:
            put, owned = module.write_point_data, msh.geometry.index_map()
            data = np.zeros((len(msh.geometry.x), V.dofmap.bs))
            data[cell_nodes(msh).ravel()] = values[V.dofmap.list.ravel()]
            data = data[: owned.size_local]
        if V.dofmap.bs == 2:  # VTK knows vectors of three components
            data = np.column_stack([data, np.zeros(len(data))])
        put(self._filename, msh, data.ravel(), t)

    def close(self) -> None:
        """Do nothing: no file is open between the times."""
