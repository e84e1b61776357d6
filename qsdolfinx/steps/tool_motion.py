"""How rigid tools go on at their rate, as bodies do, so that contact finds them where it was."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import rotation_vector
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class ToolRate(typing.NamedTuple):
    """Of a tool's motion in the last step.

    Attributes:
        displacement: Of its centre, length per time, shape (gdim,).
        rotation: Radians per time, as ``RigidSurface.rotation``.
    """

    displacement: Array
    rotation: Array

    @classmethod
    def zero(cls, tool: RigidSurface) -> ToolRate:
        """Of a tool that rests."""
        return cls(np.zeros_like(tool.displacement), np.zeros_like(tool.rotation))

    @classmethod
    def since(cls, tool: RigidSurface, before: Pose, dt: float) -> ToolRate:
        """Of a tool that has come from another pose."""
        now = tool.state.pose
        center = tool.center
        came_from = before(now.R.T @ (center - now.t))
        turned = rotation_vector(now.R @ before.R.T)
        return cls(np.asarray((center - came_from) / dt), np.asarray(turned / dt))

    def go_ahead(self, tool: RigidSurface, time: float) -> None:
        """Let the tool go on at this rate; what is left of its motion stays to be made."""
        if not np.any([*self.displacement, *self.rotation]):
            return
        displacement, rotation = time * self.displacement, time * self.rotation
        if tool.driven is not None:  # nobody knows how far a force will push it
            further = displacement - tool.displacement, rotation - tool.rotation
            missing = tool.driven.missing(*further)
            tool.displacement = tool.displacement + missing[0]
            tool.rotation = tool.rotation + missing[1]
        tool.go_ahead(displacement, rotation)


def left_until(tool: RigidSurface, before: Pose, part: float) -> tuple[Array, Array]:
    """Displacement and rotation that bring a tool to a part of its step.

    Args:
        tool: The tool, which has made some of its motion already.
        before: Where it was when the step began.
        part: Of the whole motion.
    """
    if part == 1:
        return tool.displacement.copy(), tool.rotation.copy()
    done = ToolRate.since(tool, before, 1.0)
    displacement = part * (done.displacement + tool.displacement) - done.displacement
    return displacement, part * (done.rotation + tool.rotation) - done.rotation
