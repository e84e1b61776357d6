"""Predict the motion of rigid tools from their rates, as for bodies, for contact detection."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import rotation_vector
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class ToolRate(typing.NamedTuple):
    """Rate of a tool's motion in the last step.

    Attributes:
        displacement: Velocity of its centre, length per time, shape (gdim,).
        rotation: Angular velocity, radians per time, as ``RigidSurface.rotation``.
    """

    displacement: Array
    rotation: Array

    @classmethod
    def zero(cls, tool: RigidSurface) -> ToolRate:
        """Rate of a tool at rest."""
        return cls(np.zeros_like(tool.displacement), np.zeros_like(tool.rotation))

    @classmethod
    def since(cls, tool: RigidSurface, before: Pose, dt: float) -> ToolRate:
        """Rate of a tool that has moved from another pose."""
        now = tool.state.pose
        center = tool.center
        came_from = before(now.R.T @ (center - now.t))
        turned = rotation_vector(now.R @ before.R.T)
        return cls(np.asarray((center - came_from) / dt), np.asarray(turned / dt))

    def go_ahead(self, tool: RigidSurface, time: float) -> None:
        """Move the tool at this rate; the rest of its prescribed motion remains."""
        if not np.any([*self.displacement, *self.rotation]):
            return
        displacement, rotation = time * self.displacement, time * self.rotation
        if tool.driven is not None:  # the displacement under a force is unknown
            further = displacement - tool.displacement, rotation - tool.rotation
            missing = tool.driven.missing(*further)
            tool.displacement = tool.displacement + missing[0]
            tool.rotation = tool.rotation + missing[1]
        tool.go_ahead(displacement, rotation)


def left_until(tool: RigidSurface, before: Pose, part: float) -> tuple[Array, Array]:
    """Displacement and rotation that bring a tool to a part of its step.

    Args:
        tool: The tool, which has made some of its motion already.
        before: Position at the start of the step.
        part: Part of the whole motion.
    """
    if part == 1:
        return tool.displacement.copy(), tool.rotation.copy()
    done = ToolRate.since(tool, before, 1.0)
    displacement = part * (done.displacement + tool.displacement) - done.displacement
    return displacement, part * (done.rotation + tool.rotation) - done.rotation
