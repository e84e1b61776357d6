"""Forces that differ between the two sides of a contact."""

from __future__ import annotations

import warnings

import numpy as np

from qsdolfinx.contact.advice import ContactWarning
from qsdolfinx.contact.contact import Contact

#: Difference of the forces, relative, that goes without a warning. At nodes several percent are
#: usual.
UNEQUAL = 0.1


class BalanceWarning(ContactWarning):
    """The forces on the slave and on the master are not each other's opposite, by far."""


def check_balance(contact: Contact) -> None:
    """Warn if the forces on the two sides differ by much. Collective.

    They can in two-half-pass contact alone, where each side's multipliers press on their own side:
    at edges that only one side sees, and with augmented multipliers, as those of one side may close
    all gaps before the other's have grown; nothing determines them then.
    """
    if contact.formulation != "two-half-pass":
        return
    forces = contact.force("slave"), contact.force("master")
    size = max(float(np.linalg.norm(force)) for force in forces)
    difference = float(np.linalg.norm(forces[0] + forces[1]))
    if difference > UNEQUAL * size:
        remedy = "use another formulation"
        if contact.augmented:
            remedy = 'use enforcement="penalty" or another formulation'
        # On all ranks: whoever turns warnings into errors gets one everywhere.
        warnings.warn(
            f"the forces on slave and master differ by {100 * difference / size:.0f} % of the "
            f"larger one, as two-half-pass contact does not balance them; {remedy}",
            BalanceWarning,
            stacklevel=2,
        )
