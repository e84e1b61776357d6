"""Deprecated attributes of :class:`qs.Contact`, available under their former names."""

from __future__ import annotations

import dataclasses
import functools
import typing
import warnings

from qsdolfinx.contact import motion
from qsdolfinx.contact.settings import ContactSettings

#: New name of each attribute, and the function that returns its value.
MOVED: dict[str, tuple[str, typing.Callable[[typing.Any], typing.Any]]] = {
    "augmented": ("settings.enforcement", lambda c: c.model.augmented),
    "overclosure": ("settings.initial_overclosure", lambda c: c.model.overclosure),
    "energy": ("stored_energy()", lambda c: c.stored_energy()),
    "eps": ("model.eps", lambda c: c.model.eps if c.model.augmented else c.model.penalty.eps),
    "tangential_penalty": ("model.tangential_eps", lambda c: c.model.tangential_eps),
    "has_automatic_penalty": ("model.penalty.automatic", lambda c: c.model.penalty.automatic),
    "stiffness": ("model.penalty.stiffness", lambda c: c.model.penalty.stiffness),
    "symmetric": ("model.symmetric", lambda c: c.model.symmetric),
    "scale": ("model.kinematics.scale", lambda c: c.model.kinematics.scale),
    "version": ("model.num_pairings", lambda c: c.model.num_pairings),
    "offset": ("model.offset", lambda c: c.model.offset or (None, None)),
    "set_offset": (
        "motion.set_offset(contact.model, …), of qsdolfinx.contact,",
        lambda c: functools.partial(motion.set_offset, c.model),
    ),
    "pairings": ("model.pairings", lambda c: c.model.pairings),
    "seconds": ("model.watch.total", lambda c: c.model.watch.total),
} | {
    field.name: (f"settings.{field.name}", lambda c, n=field.name: getattr(c.settings, n))
    for field in dataclasses.fields(ContactSettings)
}


def moved(contact: typing.Any, name: str) -> typing.Any:
    """Return an attribute that was renamed, with a warning that gives the new name.

    Raises:
        AttributeError: If there has never been an attribute of this name.
    """
    if name not in MOVED:
        raise AttributeError(f"Contact has no attribute {name!r}", name=name, obj=contact)
    place, find = MOVED[name]
    place = place if place.startswith("motion.") else f"contact.{place}"
    warnings.warn(f"contact.{name} is {place} now", DeprecationWarning, stacklevel=3)
    return find(contact)
