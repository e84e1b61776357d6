"""Arguments of a contact, read-only: the object ``contact.settings``."""

from __future__ import annotations

import dataclasses

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.laws import Law


@dataclasses.dataclass(frozen=True)
class ContactSettings:
    """Arguments of :class:`qs.Contact`, with the values chosen for those not given.

    Attributes:
        name: Name of the contact in messages.
        law: Contact law: gives the multiplier for a gap.
        friction: The law of friction; None without friction.
        sliding: ``"small"`` or ``"finite"``.
        formulation: ``"master-slave"``, ``"double-pass"`` or ``"quasi-symmetric"``: determines
            which surfaces are sampled, and which carry multipliers.
        enforcement: ``"penalty"`` or ``"augmented-lagrangian"``.
        penalty: ε (stress per length); None until an automatic one has been computed.
        friction_penalty: ε in tangential direction, as given; None for the penalty of the gaps.
        penalty_source: How ε was chosen, in words.
        gap_tolerance: Gap that multipliers may leave, in units of the smallest facet.
        allowed_gap: The same as a length.
        constraints: Where the contact law is evaluated, at ``"nodes"`` or ``"points"``.
        initial_overclosure: How penetration at the first contact detection is treated.
        search_radius: Search distance (length) beyond which nothing is paired; if it varies, the
            largest value.
        quadrature: ``"nodal"`` or ``"overlay"``.
        quadrature_degree: Degree of the rule on the segments of the overlay.
        normals: ``"facet"`` or ``"bisector"``.
        unknown: ``"displacement"`` or ``"velocity"``, of the slave's and the master's body.
        dt: Δt (time); None if nothing depends on it.
    """

    name: str | None
    law: Law
    friction: Friction | None
    sliding: str
    formulation: str
    enforcement: str
    penalty: float | None
    friction_penalty: float | None
    penalty_source: str
    gap_tolerance: float
    allowed_gap: float
    constraints: str
    initial_overclosure: str
    search_radius: float
    quadrature: str
    quadrature_degree: int
    normals: str
    unknown: tuple[str, str]
    dt: float | None


def settings_of(model: ContactModel) -> ContactSettings:
    """Those of a contact as it is now."""
    settings = model.settings
    friction = model.friction
    return ContactSettings(
        model.name,
        model.law,
        None if friction is None else friction.law,
        settings.sliding,
        settings.formulation,
        "augmented-lagrangian" if model.augmented else "penalty",
        model.penalty.value,
        None if friction is None else friction.given_penalty,
        model.penalty.source,
        settings.gap_tolerance,
        model.allowed_gap,
        settings.constraints,
        model.overclosure.treatment,
        model.paired.search_radius,
        settings.sampling.quadrature,
        settings.sampling.degree,
        settings.sampling.normals,
        model.kinematics.unknown,
        model.kinematics.dt,
    )
