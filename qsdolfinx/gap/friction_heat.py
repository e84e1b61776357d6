"""Heat of friction as a load on both sides of a thermal contact."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]


class FrictionHeat:
    """Distributes the power of friction at the slave's nodes to both bodies, and conserves it.

    The power of a slave node is distributed over both sides at the contact quadrature points of the
    node. The power of nodes without contact quadrature points goes into the slave.

    Args:
        slave: Surface of the temperature of the slave.
        master: Surface of the temperature of the master, or a rigid tool; heat that goes into a
            tool is not followed further.
        points: Contact quadrature points between the two surfaces.
        share: Part of the heat that goes into the slave.
    """

    def __init__(
        self, slave: Surface, master: AnySurface, points: _cpp.PairingPoints, share: float
    ) -> None:
        self._slave, self._share = slave, share
        surfaces = slave.cpp_object, master.cpp_object
        self._operator = _cpp.GapOperator(*surfaces, points, jump=True, rows=1)
        #: Heat per time at the slave's owned nodes, shape (nodes,).
        self.power: Array = np.zeros(len(slave.node_area))

    def add_to(self, b: tuple[PETSc.Vec, PETSc.Vec | None]) -> None:
        """Subtract the heat from the residuals of the two bodies. Collective."""
        row_node = self._operator.row_node
        into = self._slave.create_vec(), None if b[1] is None else b[1].duplicate()
        at_rows = np.ascontiguousarray(self.power[row_node][:, None])
        self._operator.add_transpose(at_rows, into[0].handle, handle_of(into[1]))
        b[0].axpy(-self._share, into[0])
        alone = np.setdiff1d(np.arange(len(self.power)), row_node)
        dofs = self._slave.node_dofs[alone, 0] - b[0].owner_range[0]
        b[0].array[dofs] -= self.power[alone]
        if b[1] is not None and into[1] is not None:
            b[1].axpy(1 - self._share, into[1])  # the master's part is negative
        for vec in into:
            if vec is not None:
                vec.destroy()
