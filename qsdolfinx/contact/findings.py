"""Warnings about a contact: each kind once, with the name of the contact and the step."""

from __future__ import annotations

import typing

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.model import ContactModel


class Check(typing.NamedTuple):
    """Check for a possible problem of a contact.

    Attributes:
        kind: Name of the finding.
        find: Function that checks a contact without changing it. It returns the problem and its
            remedy, or None for no problem. Collective.
        category: Class of the warning.
    """

    kind: str
    find: typing.Callable[[ContactModel], str | None]
    category: type[ContactWarning] = ContactWarning


def look(model: ContactModel, checks: typing.Iterable[Check]) -> None:
    """Run the checks that have not found anything yet, and warn of findings. Collective."""
    for check in checks:
        if check.kind in model.told:
            continue
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
