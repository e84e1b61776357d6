"""What is said of a contact: each kind of finding once, with the contact's name and the step."""

from __future__ import annotations

import typing

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.model import ContactModel


class Check(typing.NamedTuple):
    """Something that may be wrong with a contact.

    Attributes:
        kind: Its name, in the field's words.
        find: Looks at a contact, without changing it; what is wrong and what to do, None for
            nothing. Collective.
        category: Class of the warning.
    """

    kind: str
    find: typing.Callable[[ContactModel], str | None]
    category: type[ContactWarning] = ContactWarning


def look(model: ContactModel, checks: typing.Iterable[Check]) -> None:
    """Make the checks that have not found anything yet, and warn of what they find. Collective."""
    for check in checks:
        if check.kind in model.told:
            continue
        text = check.find(model)
        if text:
            tell(model, check.kind, text, check.category)


def tell(
    model: ContactModel, kind: str, text: str, category: type[ContactWarning] = ContactWarning
) -> None:
    """Warn, on all ranks, unless the kind has been told of the contact before."""
    if kind in model.told:
        return
    warn(text if model.name is None else f"contact {model.name!r}: {text}", category)
    model.told.add(kind)  # not if the warning has been made an error
