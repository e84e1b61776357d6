"""Positions of contact detection in a time step, and the decision to repeat it."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.motion import follow_meshes, set_offset, set_start
from qsdolfinx.contact.slid import slid, turned
from qsdolfinx.contact.turned import turning_error
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.mesh_motion import MeshMotion
from qsdolfinx.steps.snapshot import Snapshot
from qsdolfinx.steps.swinging import swings
from qsdolfinx.steps.tool_motion import ToolRate, left_until
from qsdolfinx.surface.affine import Affine, rotation_about, rotation_matrix
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]

#: Distance along a surface, over the size of a facet, between the positions of contact detection
#: and the solution, above which the contact pairs are updated again in the step: with more, points
#: act at earlier positions of the other surface. The second value is for velocity-based bodies,
#: whose steps are longer.
FAR, FAR_FLOWING = 0.05, 0.25

#: Rotation (radians) of facets since contact detection, above which the contact pairs are updated
#: again, too: forces have the same relative error. With more, blocks that turn together gain a
#: moment: ``tests/steps/test_large_steps.py``.
FAR_TURNED = 0.02

#: Spurious traction of a tie from gaps that rotate by small rotations, over the largest traction,
#: above which the gaps are computed again from the position of the solution. With more, tied
#: surfaces drift apart: ``tests/steps/test_ties.py``.
TURNED = 0.01


class DistortedError(RuntimeError):
    """A mesh is invalid at the position of contact detection."""


class Pairings:
    """Positions of surfaces at contact detection in a step.

    Displacement-based bodies, and surfaces that touch them, are paired at the end of the step.
    Velocity-based bodies are paired after a part θ of it, so that their forces act along the
    normals there (with θ = 0 at its start, and at its end if the contact pairs are updated again).

    Args:
        problem: The problem.
        motions: Mesh motions of its bodies.
        tools: Rigid tools, each once.
        in_velocity: Whether a body has velocities.
        theta: θ.
    """

    def __init__(
        self,
        problem: ContactProblem,
        motions: typing.Sequence[MeshMotion],
        tools: typing.Sequence[RigidSurface],
        in_velocity: typing.Sequence[bool],
        theta: float,
    ) -> None:
        self._problem, self._motions, self._tools = problem, motions, tools
        self._in_velocity, self._theta = in_velocity, theta
        #: Difference between the last solution and the prediction for the step (length).
        self.missed: list[Array] = []

    def begin(
        self,
        dt: float,
        start: Snapshot,
        rates: list[Array],
        tool_rates: typing.Sequence[ToolRate],
    ) -> None:
        """Update the contact pairs at the positions predicted by the last step's rates. Collective.

        Args:
            dt: Δt.
            start: State at the start of the step.
            rates: Velocities of the last step, length per time; for velocity-based bodies they
                determine the positions of the meshes in the solve.
            tool_rates: Velocities of the tools.

        Raises:
            DistortedError: If a cell is inverted on the way.
        """
        self._dt, self._start, self._known = dt, start, rates
        self._rates = rates
        for motion, flows, rate in zip(self._motions, self._in_velocity, rates, strict=True):
            if not flows:
                motion.u.x.array[:] += dt * rate
        self._expected = [motion.u.x.array.copy() for motion in self._motions]
        for tool, tool_rate in zip(self._tools, tool_rates, strict=True):
            tool_rate.go_ahead(tool, self._part_of_step(tool, self._theta) * dt)
        self._pair(self._places(rates, self._theta))

    def learn_velocities(self) -> None:
        """Update contact pairs and meshes at the positions given by the new velocities. Collective.

        Raises:
            DistortedError: As :meth:`begin`.
        """
        self._known = [motion.u.x.array.copy() for motion in self._motions]
        self.again()

    def again(self) -> None:
        """Update the contact pairs at the positions of the solution. Collective.

        Raises:
            DistortedError: As :meth:`begin`.
        """
        for tool in self._tools:
            tool.go_ahead(*self._left(tool))
        self._pair(self._now())

    def have_slid(self) -> bool:
        """Whether contact is far from the positions of contact detection. Collective."""
        off = [now - at for now, at in zip(self._now(), self._paired, strict=True)]
        ways = [self._way(tool) for tool in self._tools]
        for contact, (s, m), t in self._sides():
            if contact.model.follows:
                continue
            if turning_error(contact.model) > TURNED:
                return True
            if not contact.model.has_gaps:  # a tie keeps its pairs
                continue
            flows = self._in_velocity[s] or (m is not None and self._in_velocity[m])
            moved = off[s], None if m is None else off[m], None if t is None else ways[t]
            if slid(contact.model, *moved) > (FAR_FLOWING if flows else FAR):
                return True
            if not flows and turned(contact.model) > FAR_TURNED:
                return True
        return False

    def swing(self, missed_before: list[Array]) -> bool:
        """Whether the prediction error of the step has changed its sign. Collective.

        Args:
            missed_before: Prediction error of the last step, length.
        """
        self.missed, moved = [], []
        for i, motion in enumerate(self._motions):
            u, flows = motion.u.x.array, self._in_velocity[i]
            unit = self._dt if flows else 1.0
            self.missed.append(unit * (u - (self._rates[i] if flows else self._expected[i])))
            moved.append(unit * u if flows else u - self._start.unknowns[i])
        return swings(self._motions, self.missed, missed_before, moved)

    # --- Places

    def _now(self) -> list[Array]:
        """Positions given by the solution, see :meth:`_places`."""
        return self._places([motion.u.x.array for motion in self._motions], self._theta or 1.0)

    def _places(self, velocities: typing.Sequence[Array], part: float) -> list[Array]:
        """Displacements from the reference meshes to the positions of contact detection."""
        return [
            part * self._dt * velocities[i] if flows else motion.u.x.array.copy()
            for i, (motion, flows) in enumerate(zip(self._motions, self._in_velocity, strict=True))
        ]

    def _part_of_step(self, tool: RigidSurface, part: float) -> float:
        """Part of the step after which a tool is paired: that of the body that it touches."""
        flows = [self._in_velocity[s] for c, (s, _), _ in self._sides() if c.master is tool]
        return part if any(flows) else 1.0

    def _left(self, tool: RigidSurface) -> tuple[Array, Array]:
        """Displacement and rotation of a tool from its position to that of contact detection."""
        part = self._part_of_step(tool, self._theta or 1.0)
        return left_until(tool, self._start.pose_of(tool), part)

    def _way(self, tool: RigidSurface) -> Affine:
        """This motion of a tool as a displacement field."""
        displacement, rotation = self._left(tool)
        return rotation_about(rotation_matrix(rotation), tool.center, displacement)

    def _sides(self) -> typing.Iterator[tuple[Contact, tuple[int, int | None], int | None]]:
        """Contacts with the numbers of their bodies, and of their tool."""
        problem, numbers = self._problem, self._problem.system.tool_numbers
        return zip(problem.contacts, problem.sides, numbers, strict=True)

    def _pair(self, places: list[Array]) -> None:
        """Update the contact pairs at these positions, and move the meshes for the solver."""
        self._paired = places
        self._follow()
        offsets, starts = [], []
        for i, (motion, moved) in enumerate(zip(self._motions, places, strict=True)):
            motion.move(motion.values(moved))
            if motion.quality() <= 0:
                raise DistortedError(f"a cell of u[{i}] turns inside out in the step")
            offsets.append(fem.Function(motion.u.function_space))
            offsets[-1].x.array[:] = -motion.carried(moved)
            starts.append(self._start_of(i))
        since = [self._start.motion_since(tool) for tool in self._tools]
        for contact, (s, m), t in self._sides():
            if contact.model.follows:
                continue
            contact.update()
            set_offset(contact.model, offsets[s], None if m is None else offsets[m])
            moved_tool = None if t is None else since[t]
            set_start(contact.model, starts[s], None if m is None else starts[m], moved_tool)
        for motion, flows, known in zip(self._motions, self._in_velocity, self._known, strict=True):
            motion.move(motion.values(known * self._theta * self._dt) if flows else 0.0)
        interrupt.look(self._problem.comm)

    def _follow(self) -> None:
        """Set the start of the step as the reference of contacts with updated geometry."""
        following = [(c.model, sides) for c, sides, _ in self._sides() if c.model.follows]
        if not following:
            return
        if any(self._in_velocity):
            for motion in self._motions:
                motion.move()
        for model, (s, m) in following:
            model.catch_up = None  # no update of the contact pairs is needed
            if any(self._in_velocity[i] for i in (s, m) if i is not None):
                follow_meshes(model)
            set_start(model, self._start_of(s), None if m is None else self._start_of(m))

    def _start_of(self, i: int) -> fem.Function:
        """Unknowns of body i at the start of the step, total displacements."""
        out = fem.Function(self._motions[i].u.function_space)
        out.x.array[:] = 0.0 if self._in_velocity[i] else self._start.unknowns[i]
        return out
