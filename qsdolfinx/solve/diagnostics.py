"""Check a converged solution for typical problems of contact."""

from __future__ import annotations

import functools
import typing

from qsdolfinx.contact.advice import CHORDS
from qsdolfinx.contact.between_nodes import find_deep_between_nodes, find_deep_corners
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.creases import find_crossing_edges, find_deep_edges
from qsdolfinx.contact.findings import Check, look
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.reach import ReachWarning, find_passed_through
from qsdolfinx.contact.slid import find_slid
from qsdolfinx.contact.tool_corners import find_deep_corners_of_master, find_loaded_corners
from qsdolfinx.contact.turned import find_turned_normals, find_turned_tie
from qsdolfinx.solve.chord_pressure import find_chord_pressure
from qsdolfinx.solve.newton import Newton

#: Checks after a single solve, in the order in which they are made.
OF_A_SOLVE = (
    Check("passed through unseen", find_passed_through, ContactType.GAPS, ReachWarning),
    Check("deep corner", find_deep_corners, ContactType.NORMAL),
    Check("deep between nodes", find_deep_between_nodes, ContactType.GAPS),
    Check("turned tie", find_turned_tie, ContactType.TIE),
    Check("slid with small sliding", find_slid, ContactType.GAPS),
    Check(
        "turned normals",
        find_turned_normals,
        ContactType.NORMAL,
        unless="slid with small sliding",
    ),
    Check("edges that cross", find_crossing_edges, ContactType.NORMAL),
    Check("deep edges", find_deep_edges, ContactType.NORMAL),
    Check("loaded corners of a tool", find_loaded_corners, ContactType.NORMAL),
    Check("deep corners of the master", find_deep_corners_of_master, ContactType.NORMAL),
)

#: Checks after a time step. The time stepper itself checks for points that have passed through, and
#: updates the contact pairs as they slide.
OF_A_STEP = tuple(
    check for check in OF_A_SOLVE if check.find not in (find_passed_through, find_slid)
)

#: Checks after an attempt at a time step, after which contact pairs may still be updated.
OF_AN_ATTEMPT = tuple(check for check in OF_A_SOLVE if check.find is find_passed_through)


def diagnose(
    newton: Newton, contact: ContactModel, checks: typing.Sequence[Check] = OF_A_SOLVE
) -> None:
    """Run the checks of a solution, and warn of the problems found. Collective.

    Args:
        newton: Newton's method, at the solution.
        contact: Contact of the system.
        checks: The checks.
    """
    chords = Check(CHORDS, functools.partial(find_chord_pressure, newton), ContactType.NORMAL)
    look(contact, checks if checks is OF_AN_ATTEMPT else [*checks, chords])
