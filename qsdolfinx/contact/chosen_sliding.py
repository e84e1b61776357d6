"""Choice between small and finite sliding where ``sliding`` is not given."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

from qsdolfinx.base.checks import require
from qsdolfinx.contact import motion
from qsdolfinx.contact.advice import chord_errors
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.model import ContactModel, Settings
from qsdolfinx.gap.following import follows
from qsdolfinx.pairing.pair import degree_of_rule


def let_follow(models: typing.Sequence[ContactModel]) -> None:
    """Give contacts finite sliding if their ``sliding`` was not given. Collective.

    Their contact pairs are updated. The following contacts keep small sliding: contacts of
    velocity-based bodies, whose contact pairs are updated in each step; contacts whose pairs are
    used by a field that is solved for at the same time; contacts with tools driven by moments;
    contacts with sharp edges close to each other, for which only small sliding has points; those
    for which only small sliding has curved facets, where chords would change the gaps; and contacts
    that have already been solved for.
    """
    paired = bodies_of_fields(models)
    for model in models:
        if not model.sliding_is_open or model.is_evaluated:
            continue
        stays = any(model is other for other in paired) or _is_turned(model)
        finite = _finite(model.settings)
        stays |= "velocity" in model.kinematics.unknown or _needs_creases(model, finite)
        stays |= _needs_curves(model, finite)
        if stays:
            continue
        model.sliding_is_open = False
        model.settings = finite
        model.penalty.let_follow()
        model.num_pairings = 0
        motion.pair_anew(model)


def _is_turned(model: ContactModel) -> bool:
    """Whether the contact has a tool that is driven by a moment."""
    return any(tool.driven is not None and tool.driven.turns for tool in model.master.tools)


def _needs_creases(model: ContactModel, finite: Settings) -> bool:
    """Whether sharp edges or corners are paired for which only small sliding has points.

    Collective.
    """
    small = model.settings
    # Corners of tools come last among the vertices; edges follow after the vertices.
    count = len(small.roles_of_vertices) - len(finite.roles_of_vertices) + len(small.roles_of_edges)
    found = any(gap.points.size for gap in model.gaps[len(model.gaps) - count :] if count)
    return bool(model.comm.allreduce(found, op=MPI.LOR))


def _needs_curves(model: ContactModel, finite: Settings) -> bool:
    """Whether finite sliding takes facets as flat that are curved, and this changes gaps.

    Collective.
    """
    if model.type not in ContactType.NORMAL:
        return False
    small, bodies = model.settings, model.bodies
    if not any(body.largest_height > 0 and body.degree == 1 for body in bodies):
        return False
    return chord_errors(small) is None and chord_errors(finite) is not None


def bodies_of_fields(models: typing.Sequence[ContactModel]) -> list[ContactModel]:
    """Contacts whose pairs are used by contacts of scalar fields in the same list."""
    of = [m.mechanics.of for m in models if m.mechanics is not None and m.mechanics.shares_pairs]
    return [model for model in models if any(model is other for other in of)]


def check_fields(models: typing.Sequence[ContactModel]) -> None:
    """Raise an error for fields solved for together with bodies that have finite sliding.

    Raises:
        ValueError: If there are such fields.
    """
    for model in bodies_of_fields(models):
        require(
            model.settings.sliding == "small",
            'contacts: a field that is solved for at once with its bodies needs sliding="small" '
            "of their contact; or solve for it after them, see qs.Staggered",
        )


def _finite(settings: Settings) -> Settings:
    """Same settings with finite sliding."""
    updated, sampling = follows("finite", settings.law), settings.sampling
    sides = settings.slave, settings.master
    sampling = sampling._replace(
        degree=sampling.degree if sampling.degree_is_given else degree_of_rule(*sides, updated),
        normals="facet",
        follows=updated,
    )
    return dataclasses.replace(settings, sliding="finite", sampling=sampling)
