"""Check for ties across a gap whose rotation is too large for the theory of small rotations."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.contact.model import ContactModel

#: Spurious traction, over the largest traction of the tie, that gaps rotated by small rotations may
#: cause. More is an error that users see: test_rings_turned_by_hand in tests/steps/test_ties.py.
NOTICED = 0.05


def find_turned_tie(model: ContactModel) -> str | None:
    """Warning about a tie that has rotated too far, or None. Collective."""
    share = turning_error(model)
    if share <= NOTICED:
        return None
    return (
        "sliding: tied surfaces with a gap between them have rotated so far since they were paired "
        f"that the linearised rotation causes {min(share, 1.0):.0%} of the largest traction: "
        'take sliding="finite", or smaller steps of a TimeStepper'
    )


def turning_error(model: ContactModel) -> float:
    """Spurious traction by the error of small rotations, over the largest one. Collective.

    It is the error of the gap times the stiffness of the bodies' nodes beside it; 0 for contact
    that is not tied.
    """
    if all(gap.turning is None for gap in model.gaps):
        return 0.0
    places = model.placement.slave.positions(), model.placement.master.positions()
    error = largest = 0.0
    for gap in model.gaps:
        both = model.ordered(gap, places)
        error = max(error, float(np.max(gap.turning_error(both), initial=0.0)))
        traction = np.linalg.norm(gap.multiplier(model.eps), axis=1)
        largest = max(largest, float(np.max(traction, initial=0.0)))
    both_found = np.array([error, largest])
    model.comm.Allreduce(MPI.IN_PLACE, both_found, op=MPI.MAX)
    error, largest = both_found
    if error <= SOLVED * model.paired.facet_size or largest * model.compliance == 0.0:
        return 0.0
    return float(error / (model.compliance * largest))
