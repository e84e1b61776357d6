"""Check the penetration of bodies and tools at the end of a step."""

from __future__ import annotations

import typing

from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact import depth
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.crossing import deepest_crossing, motion_since
from qsdolfinx.contact.passed import find_passed
from qsdolfinx.contact.placement import Placement
from qsdolfinx.contact.reach import reach
from qsdolfinx.pairing.ahead import DEEPEST
from qsdolfinx.surface.deformed import DegenerateFacetsError


class Penetration:
    """Check for points with too large a penetration at the end of a step, whatever the cause.

    Args:
        contacts: The contacts.
        limit: Largest accepted depth (length), ``"auto"``, or None for no limit.
    """

    def __init__(self, contacts: typing.Sequence[Contact], limit: float | str | None) -> None:
        self._contacts, self.limit = contacts, limit
        #: Bound of the depth of each contact at the end of the last step; None if unknown.
        self._known: list[float | None] = [None for _ in contacts]
        self._new = list(self._known)

    @property
    def is_limited(self) -> bool:
        """Whether there is a limit."""
        return self.limit is not None

    def starts(self) -> list[Placement]:
        """Positions of the surfaces of each contact, before a step."""
        return [contact.model.placement.as_given for contact in self._contacts]

    def fault(self, starts: typing.Sequence[Placement]) -> str | None:
        """Describe the largest penetration if it is too deep, and its place; else None. Collective.

        Args:
            starts: Positions of the surfaces at the start of the step.
        """
        if self.limit is None:
            return None
        self._new = list(self._known)
        for i, (contact, start) in enumerate(zip(self._contacts, starts, strict=True)):
            if self.limit == "auto" and not contact.model.has_gaps:
                continue
            try:
                text = self._fault(i, contact, start)
            except DegenerateFacetsError as error:  # the step is too large for these facets
                text = str(error)
            if text is not None:
                return text if len(self._contacts) == 1 else f"{contact.model.called(i)}: {text}"
        return None

    def accept(self) -> None:
        """Keep the bounds at the end of this step for the next step."""
        self._known = self._new

    def _fault(self, i: int, contact: Contact, start: Placement) -> str | None:
        model, known, limit = contact.model, self._known[i], self._limit(contact)
        passed = find_passed(model, start)
        if passed is not None:
            return f"{passed} has passed through a part of the other surface"
        moved = motion_since(model, start)
        # Half of the motion that brings no point in from beyond the contact pairs.
        seen = moved <= 0.5 * reach(model)
        if self.limit == "auto" and seen and known is not None and known + moved <= limit:
            self._new[i] = known + moved
            return None
        allowed = contact.model.overclosure.allowed
        self._new[i] = deepest = depth.penetration(model)
        too_deep = deepest - allowed > limit
        # Points that count as active have no place.
        place = next(iter(depth.deepest(model, 1)), None) if too_deep else None
        if not seen:
            unpaired = NOTICED * model.paired.facet_size
            crossing = deepest_crossing(model, start, moved, limit + allowed, unpaired)
            if crossing is not None and (place is None or crossing.depth > place.depth):
                place = crossing
        if place is None and not too_deep:
            return None
        if place is not None and place.depth <= limit + allowed:
            return f"{place} has passed through the other surface without being detected"
        name = "max_penetration" if self.limit != "auto" else "max_penetration (by default)"
        return f"a penetration of {place or f'{deepest:.4g}'}, above {name} = {limit:.4g}"

    def _limit(self, contact: Contact) -> float:
        if isinstance(self.limit, float):
            return self.limit
        return DEEPEST * contact.model.settings.largest_facet
