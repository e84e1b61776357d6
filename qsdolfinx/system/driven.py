"""Force-controlled rigid tools: derivatives of constraints by their motion, and equilibrium."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import motion
from qsdolfinx.surface.affine import Affine
from qsdolfinx.system.constraint_rows import Evaluated
from qsdolfinx.system.passes import Pass, State
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class DrivenTools:
    """Equilibrium R_s = Σ W λ ∂ḡ/∂s + Σ W τ ∂g/∂s − force of each tool, see ``Equations``.

    Args:
        tools: The tools, in the order of s.
        passes: Integration sides of the contacts.
        comm: The communicator.
    """

    def __init__(
        self, tools: typing.Sequence[RigidSurface], passes: typing.Sequence[Pass], comm: MPI.Comm
    ) -> None:
        self.tools, self._passes, self._comm = tools, passes, comm
        self.restart()

    def restart(self) -> None:
        """Measure displacements of the tools from their present positions."""
        self._starts = [(tool.displacement.copy(), tool.rotation.copy()) for tool in self.tools]

    def move(self, displacements: Array) -> None:
        """Move the tools by displacements (length) from their start positions. Collective."""
        for tool, start, s in zip(self.tools, self._starts, displacements, strict=True):
            tool.move_driven(start, s)
        for contact in {id(p.model): p.model for p in self._passes if p.tool is not None}.values():
            motion.move_tool(contact)

    def changes(self, p: Pass) -> tuple[Array, Array | None]:
        """Derivatives ∂ḡ/∂s and ∂g/∂s of constraints with a force-controlled tool. Collective."""
        assert p.tool is not None
        return self._moved_by(p, self.tools[p.tool].driven_motion)

    def _moved_by(self, p: Pass, field: Affine) -> tuple[Array, Array | None]:
        """Change of gaps and slips when the tool moves by a field. Collective."""
        slip = None if p.slip is None else p.slip.tangential(p.slip.change(field))
        return p.gap.change(field), slip

    def residual(self, passes: typing.Sequence[Evaluated]) -> Array:
        """Residual R_s on all ranks. Collective."""
        if not self.tools:
            return np.zeros(0)
        out = self._work_of([tool.driven_motion for tool in self.tools], passes)
        forces = [tool.driven.force for tool in self.tools if tool.driven is not None]
        return out - np.array(forces)

    def _work_of(
        self, fields: typing.Sequence[Affine | None], passes: typing.Sequence[Evaluated]
    ) -> Array:
        """Work of the tractions when each tool moves by a field, on all ranks. Collective."""
        out = np.zeros(len(self.tools))
        for p, e in zip(self._passes, passes, strict=True):
            field = None if p.tool is None else fields[p.tool]
            if p.tool is None or field is None:
                continue
            gap, slip = self._moved_by(p, field)
            out[p.tool] += np.sum(p.gap.weight[:, None] * e.pressure * gap)
            if slip is not None and p.slip is not None and e.tangential is not None:
                weight = p.slip.weight[:, None]
                out[p.tool] += np.sum(weight * e.tangential.traction * slip)
        self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
        return out

    @property
    def are_turning(self) -> bool:
        """Whether a moment drives a tool: its constraints' derivatives then vary with its angle."""
        return any(tool.driven is not None and tool.driven.turns for tool in self.tools)

    def turned(self, at: State) -> Array:
        """Derivative ∂R_s/∂s at given tractions, for rotating tools, on all ranks. Collective."""
        if not self.are_turning:
            return np.zeros(len(self.tools))
        return self._work_of([tool.driven_curvature for tool in self.tools], at.passes)

    def way(self, p: Pass) -> tuple[float, float, float]:
        """Motion of a force-controlled tool that does not rotate, per displacement."""
        assert p.tool is not None
        x, y, z = (*map(float, self.tools[p.tool].driven_motion.b), 0.0)[:3]
        return x, y, z
