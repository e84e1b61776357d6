"""State of a contact after a solve, restored if later attempts fail."""

from __future__ import annotations

import copy

from qsdolfinx.contact import motion
from qsdolfinx.contact.model import ContactModel


class ContactState:
    """Copy of the present contact pairs, gaps, multipliers and slip of a contact.

    Args:
        model: The contact.
    """

    def __init__(self, model: ContactModel) -> None:
        self._model = model
        # Results of contact detection and arrays of states are never written into: references
        # suffice.
        self._paired = model.paired
        self._states = [copy.copy(part.state) for part in model.parts]
        self._cuts = [gap.cut for gap in model.gaps]
        self._penalty = copy.copy(model.penalty)
        self._dt = model.kinematics.dt
        self._friction = None if model.friction is None else model.friction.state
        self._catch_up = model.catch_up
        self._kept, self._is_evaluated = model.kept, model.is_evaluated
        self._placement, self._tool_motion = model.placement, model.tool_motion
        self._surfaces = [(surface, surface.coordinates) for surface in model.bodies]
        self._offset = None
        if model.offset is not None:
            self._offset = [None if v is None else v.array_r.copy() for v in model.offset]

    def restore(self) -> None:
        """Restore the complete state."""
        model = self._model
        for surface, coordinates in self._surfaces:
            surface.coordinates = coordinates
        model.paired = self._paired
        for part, state in zip(model.parts, self._states, strict=True):
            part.state = copy.copy(state)
        for gap, cut in zip(model.gaps, self._cuts, strict=True):
            if cut is not None:
                gap.show(cut)
        for slip in model.slips if model.follows else ():
            slip.take_operator()
        model.penalty = copy.copy(self._penalty)
        model.kinematics.restore_dt(self._dt)
        if model.friction is not None and self._friction is not None:
            model.friction.restore(self._friction)
        model.catch_up = self._catch_up
        model.kept, model.is_evaluated = self._kept, self._is_evaluated
        model.placement, model.tool_motion = self._placement, self._tool_motion
        if self._offset is None:
            motion.free_offset(model)
            return
        for vec, array in zip(model.offset or (), self._offset, strict=True):
            if vec is not None:
                vec.array[:] = array
