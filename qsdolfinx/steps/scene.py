"""Bodies, contacts and tools of one problem, as moved by time steps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.mesh_motion import MeshMotion
from qsdolfinx.steps.motion_limits import MotionLimits
from qsdolfinx.steps.pairings import Pairings
from qsdolfinx.steps.penetration import Penetration
from qsdolfinx.steps.snapshot import Snapshot
from qsdolfinx.steps.staggered import Staggered
from qsdolfinx.steps.tool_motion import ToolRate

Array = npt.NDArray[np.float64]


class Scene:
    """A problem as used by time steps; each remeshing creates a new scene.

    Args:
        problem: The problem.
        theta: Part of a step after which velocity-based bodies are solved for.
        max_rotation: See :class:`qs.TimeStepper`.
        max_slip: See :class:`qs.TimeStepper`.
        max_penetration: See :class:`qs.TimeStepper`.
        staggered: Problem that is solved after the bodies in each step; None if there is none.
    """

    def __init__(
        self,
        problem: ContactProblem,
        theta: float,
        max_rotation: float | None,
        max_slip: float | None,
        max_penetration: float | str | None,
        staggered: Staggered | None = None,
    ) -> None:
        self.problem = problem
        self.staggered = staggered
        #: Mesh motions of the bodies.
        self.motions = [
            MeshMotion(u, is_ring)
            for u, is_ring in zip(problem.u, _are_rings(problem), strict=True)
        ]
        #: Rigid tools, each once.
        self.tools = list(problem.system.tools)
        self.in_velocity = [kind == "velocity" for kind in problem.unknowns]
        #: Velocities of the last step, as ``TimeStepper.rates``.
        self.rates: list[Array] = [np.zeros_like(u.x.array) for u in problem.u]
        #: Velocities of the rigid tools in the last step.
        self.tool_rates = [ToolRate.zero(tool) for tool in self.tools]
        #: Difference between the last step and its prediction, length.
        self.missed: list[Array] = [np.zeros_like(u.x.array) for u in problem.u]
        self.limits = MotionLimits(problem.contacts, max_rotation, max_slip)
        self.penetration = Penetration(problem.contacts, max_penetration)
        self.pairings = self.pairings_after(theta)

    def pairings_after(self, theta: float) -> Pairings:
        """Contact detection in a step whose velocity-based bodies are solved for after θ."""
        return Pairings(self.problem, self.motions, self.tools, self.in_velocity, theta)

    def snapshot(self) -> Snapshot:
        """Snapshot of the present state."""
        return Snapshot(self.problem, self.motions, self.tools)


def _are_rings(problem: ContactProblem) -> list[bool]:
    """Whether each body is axisymmetric, according to the surfaces of its contacts."""
    out = [False] * len(problem.u)
    for contact, sides in zip(problem.contacts, problem.sides, strict=True):
        for i in sides:
            if i is not None:
                out[i] = contact.slave.axisymmetric
    return out
