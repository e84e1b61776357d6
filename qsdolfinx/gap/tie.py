"""Relative motion of the two sides of a tie since the tie was made."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import Affine, affine_vec, trace_positions, trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
#: Positions of the trace's nodes of the slave and of a deformable master, (facets, nodes, 3).
Places = tuple[Array, Array | None]
Vecs = tuple[PETSc.Vec | None, PETSc.Vec | None]


class Tie:
    """Positions of meshes and a tool when a tie was made; its pairs are fixed material points.

    Displacements of the unknowns count from the meshes. The motion of the meshes themselves, as of
    velocity-based bodies, is also part of the relative displacement.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
    """

    def __init__(self, slave: Surface, master: AnySurface) -> None:
        self._bodies = slave, *master.bodies
        self._x = self.places()
        self._values: list[TraceValues] | None = None
        self._tools = [(tool, tool.state.pose) for tool in master.tools]

    def places(self) -> Places:
        """Positions of the two surfaces at their last update."""
        slave, *master = map(trace_positions, self._bodies)
        return slave.copy(), next(iter(master), None)

    def values(self, u: Vecs) -> Places:
        """Values of the two bodies' vectors at the nodes of the trace. Collective."""
        if self._values is None:
            self._values = [TraceValues(surface) for surface in self._bodies]
        out = [None if v is None else of(v) for of, v in zip(self._values, u, strict=False)]
        slave, master = (*out, None)[:2]
        return np.zeros_like(self._x[0]) if slave is None else slave, master

    def moved(
        self, places: Places | None, u: Vecs, scale: tuple[float, float], offset: Places | None
    ) -> Places:
        """Positions of the displaced surfaces. Collective.

        Args:
            places: Positions without these displacements; None for those at which they were tied.
            u: Unknowns of both bodies.
            scale: Displacement per unknown.
            offset: Additional displacements, as returned by :meth:`values`; None for none.
        """
        out = list(places or self._x)
        for i, moved in enumerate(self.values(u)):
            x, more = out[i], None if offset is None else offset[i]
            if x is not None and moved is not None:
                out[i] = x + scale[i] * moved + (0.0 if more is None else more)
        assert out[0] is not None
        return out[0], out[1]

    def motion(self, places: Places | None) -> tuple[PETSc.Vec, PETSc.Vec | None]:
        """Relative motion that is not in the unknowns: new vectors of the two bodies. Collective.

        The motion of a tool is counted as the opposite motion of the slave.

        Args:
            places: Positions of the surfaces; None for those at which they were tied.
        """
        changes = zip(self._bodies, places or self._x, self._x, strict=False)
        slave, *master = (
            trace_vec(surface, (now - before)[..., : surface.gdim])
            for surface, now, before in changes
            if now is not None and before is not None
        )
        moved = self._of_tool()
        if moved is not None:
            r = affine_vec(self._bodies[0], moved, self._x[0])
            slave.axpy(-1.0, r)
            r.destroy()
        return slave, next(iter(master), None)

    def of_tool(self, field: Affine) -> PETSc.Vec:
        """Values of a field over the tool's present position at the slave's unknowns. Collective.

        The position of the slave is taken as if it had moved with the tool.
        """
        moved = self._of_tool()
        if moved is not None:
            field = Affine(field.A @ (moved.A + np.eye(len(moved.b))), field.A @ moved.b + field.b)
        return affine_vec(self._bodies[0], field, self._x[0])

    def _of_tool(self) -> Affine | None:
        """Motion of a tool since the tie was made, as a field over its position then."""
        return next((tool.state.pose.since(pose) for tool, pose in self._tools), None)
