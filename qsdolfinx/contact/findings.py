"""Warnings about a contact: each kind once, with the name of the contact and the step."""

from __future__ import annotations

import typing

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.model import ContactModel


class Check(typing.NamedTuple):
    """Check for a possible problem of a contact.

    Attributes:
        kind: Name of the finding.
        find: Function that checks a contact without changing it. It returns the problem and its
            remedy, or None or an empty text for no problem. Collective.
        meant_for: Types of contacts that are checked; ``find`` is not called for others.
        category: Class of the warning.
        unless: Kind of a finding that explains this one: after it, there is no check.
    """

    kind: str
    find: typing.Callable[[ContactModel], str | None]
    meant_for: ContactType
    category: type[ContactWarning] = ContactWarning
    unless: str = ""


def look(model: ContactModel, checks: typing.Iterable[Check]) -> None:
    """Run the checks that are meant for a contact, and warn of findings. Collective.

    A check that has found something before is not run again.
    """
    for check in checks:
        if model.type in check.meant_for and not {check.kind, check.unless} & model.told:
            text = check.find(model)
            if text:
                tell(model, check.kind, text, check.category)


def tell(
    model: ContactModel, kind: str, text: str, category: type[ContactWarning] = ContactWarning
) -> None:
    """Warn, on all ranks, unless this kind of warning was given for the contact before."""
    if kind in model.told:
        return
    warn(text if model.name is None else f"contact {model.name!r}: {text}", category)
    model.told.add(kind)  # not if warnings are turned into errors
