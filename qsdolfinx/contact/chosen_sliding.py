"""Whether contact's geometry follows the bodies, where the user leaves that open."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

from qsdolfinx.base.checks import require
from qsdolfinx.contact import motion
from qsdolfinx.contact.model import ContactModel, Settings
from qsdolfinx.pairing.pair import degree_of_rule
from qsdolfinx.pairing.relief import Smoothing
from qsdolfinx.tools.rigid_surface import as_tool


def let_follow(models: typing.Sequence[ContactModel]) -> None:
    """Give contacts finite sliding if their ``sliding`` is left open. Collective.

    They pair anew. Small sliding stay those of bodies in velocities, which pair anew in each step;
    those that a field which is solved for at once takes its pairs from; those with tools that
    moments drive; those near whose creases small sliding alone has points; and those that have been
    solved for.
    """
    paired = bodies_of_fields(models)
    for model in models:
        if not model.sliding_is_open or model.is_evaluated:
            continue
        stays = any(model is other for other in paired) or _is_turned(model)
        finite = _finite(model.settings)
        stays |= "velocity" in model.kinematics.unknown or _needs_creases(model, finite)
        if stays:
            continue
        model.sliding_is_open = False
        model.settings = finite
        model.penalty.let_follow()
        model.num_pairings = 0
        motion.pair_anew(model)


def _is_turned(model: ContactModel) -> bool:
    """Whether a moment drives its tool."""
    tool = as_tool(model.master)
    return tool is not None and tool.driven is not None and tool.driven.turns


def _needs_creases(model: ContactModel, finite: Settings) -> bool:
    """Whether creases or corners are near each other that small sliding alone has points of.

    Collective.
    """
    small = model.settings
    # Corners of tools are the last of the vertices, and edges come after these.
    count = len(small.roles_of_vertices) - len(finite.roles_of_vertices) + len(small.roles_of_edges)
    found = any(gap.points.size for gap in model.gaps[len(model.gaps) - count :] if count)
    return bool(model.comm.allreduce(found, op=MPI.LOR))


def bodies_of_fields(models: typing.Sequence[ContactModel]) -> list[ContactModel]:
    """Those among contacts whose pairs scalar fields among them have."""
    of = [m.mechanics.of for m in models if m.mechanics is not None and m.mechanics.shares_pairs]
    return [model for model in models if any(model is other for other in of)]


def check_fields(models: typing.Sequence[ContactModel]) -> None:
    """Refuse fields that are solved for at once with bodies that contact follows.

    Raises:
        ValueError: If there are any.
    """
    for model in bodies_of_fields(models):
        require(
            model.settings.sliding == "small",
            'contacts: a field that is solved for at once with its bodies needs sliding="small" '
            "of their contact; or solve for it after them, see qs.Staggered",
        )


def _finite(settings: Settings) -> Settings:
    """The same with finite sliding."""
    follows, sampling = not settings.law.jump, settings.sampling
    sides = settings.slave, settings.master
    sampling = sampling._replace(
        degree=sampling.degree if sampling.degree_is_given else degree_of_rule(*sides, follows),
        normals="facet",
        smoothing=Smoothing(*sides, (None, None), follows),
    )
    return dataclasses.replace(settings, sliding="finite", sampling=sampling)
