"""Store the state before an attempt at a time step, to restore it after a failure."""

from __future__ import annotations

import typing

import numpy as np

from qsdolfinx.contact import multipliers
from qsdolfinx.contact.state import ContactState
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.mesh_motion import MeshMotion
from qsdolfinx.surface.affine import Affine
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import RigidSurface


class Snapshot:
    """State at the start of a step.

    Args:
        problem: The problem.
        motions: Mesh motions of its bodies.
        tools: Rigid tools.
    """

    def __init__(
        self,
        problem: ContactProblem,
        motions: typing.Sequence[MeshMotion],
        tools: typing.Sequence[RigidSurface],
    ) -> None:
        self._contacts, self._motions, self._tools = problem.contacts, motions, tools
        #: Unknowns of the bodies, including ghosts.
        self.unknowns = [u.x.array.copy() for u in problem.u]
        self._multipliers = [multipliers.on_nodes(c.model.parts) for c in problem.contacts]
        self._shown = [ContactState(contact.model) for contact in problem.contacts]
        self._states = [tool.state for tool in tools]

    def pose_of(self, tool: RigidSurface) -> Pose:
        """Position of a tool at the snapshot."""
        both = zip(self._tools, self._states, strict=True)
        return next(state.pose for known, state in both if known is tool)

    def motion_since(self, tool: RigidSurface) -> Affine:
        """Displacement of a tool since the snapshot, as a field over its present position."""
        before = self.pose_of(tool).matrix
        d = before.shape[0]
        back = (tool.position[:, :d] @ before[:, :d].T).T
        return Affine(np.eye(d) - back, back @ tool.position[:, d] - before[:, d])

    def restore(self) -> None:
        """Restore unknowns, meshes, tools, and the results of the contacts."""
        for motion, unknowns in zip(self._motions, self.unknowns, strict=True):
            motion.u.x.array[:] = unknowns
            motion.move()
        for shown in self._shown:
            shown.restore()
        for tool, state in zip(self._tools, self._states, strict=True):
            tool.restore(state)

    def restore_multipliers(self) -> None:
        """Restore the multipliers at the nodes that are paired now."""
        for contact, kept in zip(self._contacts, self._multipliers, strict=True):
            multipliers.set_on_nodes(contact.model.parts, kept)
