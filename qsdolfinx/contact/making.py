"""Make a contact from its arguments: checks, automatic choices, and the parts of the contact."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

from qsdolfinx.base.checks import POSITIVE, Kind, check, either, instance, one_of, require
from qsdolfinx.base.collective import checked
from qsdolfinx.base.messages import renamed
from qsdolfinx.contact import bodies, conduction
from qsdolfinx.contact.across import BodiesContact, check_of, shares_pairs
from qsdolfinx.contact.arguments import (
    Given,
    check_constraints,
    check_field,
    check_formulation,
    check_friction,
    check_friction_use,
    check_itself,
    check_memory,
    check_of_use,
    check_sliding,
    check_surfaces,
    default_constraints,
    default_enforcement,
)
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.model import ContactModel, Settings
from qsdolfinx.contact.penalty import Penalty, points_factor
from qsdolfinx.friction.history import FrictionHistory
from qsdolfinx.gap import law_samples
from qsdolfinx.gap.following import follows
from qsdolfinx.gap.kinematics import Kinematics, unknowns_of
from qsdolfinx.gap.laws import BUILT_IN, Conductance, Law, Tied, Unilateral
from qsdolfinx.gap.overclosure import Overclosure
from qsdolfinx.gap.rows import CONSTRAINTS
from qsdolfinx.pairing.facets import SharpNodes, has_creases
from qsdolfinx.pairing.pair import NORMALS, QUADRATURES, Sampling, check_quadrature
from qsdolfinx.surface.itself import boundary_of
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

NAME = Kind(
    "a string that is not empty", lambda x: isinstance(x, str) and bool(x.strip()), TypeError
)
SLIDING = ("small", "finite")
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")

NO_SMOOTHING = (
    "smoothing: has been removed, leave it out; contact is between curved facets on meshes of "
    "degree 2: msh = qs.elevate(msh, facet_tags, tag), with shape=qs.smooth.Cylinder(...) or "
    "another one for a known surface"
)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Arguments of :class:`qs.Contact`; they may have any type before they are checked."""

    slave: typing.Any
    master: typing.Any
    name: typing.Any
    law: typing.Any
    friction: typing.Any
    sliding: typing.Any
    formulation: typing.Any
    enforcement: typing.Any
    penalty: typing.Any
    friction_penalty: typing.Any
    gap_tolerance: typing.Any
    constraints: typing.Any
    initial_overclosure: typing.Any
    search_radius: typing.Any
    quadrature: typing.Any
    quadrature_degree: typing.Any
    normals: typing.Any
    unknown: typing.Any
    dt: typing.Any
    mechanics: typing.Any
    of: typing.Any
    smoothing: typing.Any

    @property
    def itself(self) -> bool:
        """Whether slave and master are one boundary."""
        return self.master is self.slave

    @property
    def augmented(self) -> bool:
        """Whether multipliers close the gaps."""
        return bool(self.enforcement == "augmented-lagrangian")


class Chosen(typing.NamedTuple):
    """Arguments after checks, with automatic choices made.

    Attributes:
        given: The arguments.
        degree: Degree of the quadrature rule on the segments of the overlay.
        sliding_is_given: Whether the user has set ``sliding``.
        may_follow: Whether a problem may change the contact to finite sliding.
    """

    given: Arguments
    degree: int
    sliding_is_given: bool
    may_follow: bool

    @property
    def follows(self) -> bool:
        """Whether gaps are updated with the deformed geometry."""
        return follows(self.given.sliding, self.given.law)


def choose(a: Arguments) -> Chosen:
    """Check arguments, and make automatic choices. Collective.

    Raises:
        ValueError, TypeError: See :class:`qs.Contact`; the same on all ranks.
    """
    if a.law is None:
        a = dataclasses.replace(a, law=Tied() if a.slave.is_scalar else Unilateral())
    with checked(a.slave.comm) as same:
        a = dataclasses.replace(a, mechanics=renamed("of", "mechanics", a.of, a.mechanics))
        require(a.smoothing is None, NO_SMOOTHING)
        check_surfaces(a.slave, a.master)
        same(slave="scalar" if a.slave.is_scalar else "vector")
        same(master="the slave" if a.itself else type(a.master).__name__)
        same(either(NAME, None), name=a.name)
        same(one_of(FORMULATIONS), formulation=a.formulation)
        if a.enforcement is None:
            a = dataclasses.replace(a, enforcement=default_enforcement(a.formulation, a.law))
        same(one_of(ENFORCEMENTS), enforcement=a.enforcement)
        check_formulation(a.formulation, a.enforcement, a.master)
        same(one_of(QUADRATURES), quadrature=a.quadrature)
        check(instance(Law, "qs.Tied() or qs.Unilateral()"), law=a.law)
        updated = follows(a.sliding, a.law)
        degree = check_quadrature(a.slave, a.master, a.quadrature, a.quadrature_degree, updated)
        check_friction(a.friction, a.slave)
        # Compare arguments before values derived from them: the message names the first that
        # differs.
        mechanics = None if a.mechanics is None else "contact"
        same(law=type(a.law).__name__, friction=a.friction, mechanics=mechanics)
        a = _check_uses(a, same)
        chosen = _choose_sliding(a, degree, same)
        a = chosen.given
        same(quadrature_degree=degree, dt=a.dt, initial_overclosure=a.initial_overclosure)
    # These need no comparison: all ranks have the same arguments.
    check_friction_use(a.friction, a.friction_penalty, a.law)
    check_constraints(a.constraints, a.quadrature, a.law)
    if isinstance(a.law, Conductance):  # h takes the place of the penalty, at each point
        chosen = chosen._replace(given=dataclasses.replace(a, penalty=1.0, constraints="points"))
    return chosen


def _check_uses(a: Arguments, same: typing.Any) -> Arguments:
    """Raise an error for inconsistent arguments; set the formulation if pairs are shared."""
    rest = Given(
        a.formulation, a.quadrature, a.unknown, a.sliding, a.initial_overclosure, a.constraints
    )
    check_field(a.slave, a.master, a.law, a.enforcement, a.friction, a.penalty, rest)
    shares = hasattr(a.mechanics, "model") and shares_pairs(a.mechanics.model, a.master)
    check_of_use(
        a.slave,
        a.law,
        a.mechanics,
        rest,
        shares,
        quadrature_degree=a.quadrature_degree,
        search_radius=a.search_radius,
        normals=a.normals,
    )
    if isinstance(a.law, Conductance):
        same(**a.law.numbers)
    a = dataclasses.replace(a, unknown=unknowns_of(a.unknown, is_rigid(a.master)))
    same(unknown=a.unknown)
    same(either(POSITIVE, "auto"), penalty=a.penalty)
    same(either(either(POSITIVE, "local"), None), search_radius=a.search_radius)
    same(POSITIVE, gap_tolerance=a.gap_tolerance)
    same(either(POSITIVE, None), friction_penalty=a.friction_penalty)
    if a.mechanics is not None:
        check_of(a.mechanics.model, a.slave, a.master)
        if shares:
            return dataclasses.replace(a, formulation=a.mechanics.model.settings.formulation)
    return a


def _choose_sliding(a: Arguments, degree: int, same: typing.Any) -> Chosen:
    """Choose and check ``sliding``, ``normals`` and ``constraints``."""
    same(either(one_of(SLIDING), None), sliding=a.sliding)
    same(either(one_of(CONSTRAINTS), None), constraints=a.constraints)
    own_normals = a.normals is not None and a.normals != "facet"
    may_follow = a.sliding is None and not own_normals and a.quadrature == "overlay"
    may_follow &= not a.slave.is_scalar and a.constraints != "nodes"
    is_given, sliding, normals = a.sliding is not None, a.sliding or "small", a.normals
    if normals is None:
        averaging = a.quadrature == "overlay" or a.friction is not None
        normals = "bisector" if averaging and sliding == "small" else "facet"
    same(one_of(NORMALS), normals=normals)
    constraints = a.constraints
    if constraints is None:
        constraints = default_constraints(
            a.quadrature, a.formulation, a.law, a.enforcement, sliding
        )
    check_memory(a.law, a.friction, a.enforcement, a.penalty)
    check_sliding(sliding, a.quadrature, normals, constraints, a.law)
    if a.itself:
        check_itself(a.formulation, a.quadrature, a.law, a.unknown)
    Overclosure(a.initial_overclosure)  # which checks it
    a = dataclasses.replace(a, sliding=sliding, normals=normals, constraints=constraints)
    return Chosen(a, degree, is_given, may_follow)


def make(chosen: Chosen) -> ContactModel:
    """Make the parts of a contact, before its first contact detection. Collective."""
    a, settings = chosen.given, _settings(chosen)
    needs_dt = a.friction is not None and a.friction.needs_dt
    if isinstance(a.law, Conductance) and a.law.friction is not None:
        needs_dt = a.mechanics is None or a.mechanics.model.kinematics.dt is None
        needs_dt |= a.dt is not None
    kinematics = Kinematics(a.unknown, a.dt, needs_dt)
    penalty = Penalty(
        a.penalty,
        a.quadrature,
        a.augmented,
        "velocity" in kinematics.unknown,
        points_factor(a.constraints, chosen.follows),
    )
    slave, master = settings.slave, settings.master
    friction = None
    if a.friction is not None:
        friction = FrictionHistory(a.friction, slave, a.friction_penalty)
    mechanics = None
    if a.mechanics is not None:
        mechanics = BodiesContact(a.mechanics.model, slave, master)
    overclosure = Overclosure(a.initial_overclosure)
    physics = conduction if a.slave.is_scalar else bodies
    model = ContactModel(settings, physics, kinematics, penalty, overclosure, friction, mechanics)
    model.sliding_is_given = chosen.sliding_is_given
    at_points = a.law.jump or a.constraints == "points"
    model.sliding_is_open = chosen.may_follow and at_points
    return model


def _settings(chosen: Chosen) -> Settings:
    """Settings of the contact from its arguments. Collective."""
    a = chosen.given
    slave, master = a.slave, a.master
    if a.itself:
        slave, master = boundary_of(slave), boundary_of(slave)
    at_points = a.constraints == "points" and not (a.itself or isinstance(a.law, Conductance))
    radius = a.search_radius
    settings = Settings(
        slave,
        master,
        a.formulation,
        a.law,
        Sampling(
            a.quadrature,
            chosen.degree,
            a.normals,
            chosen.follows,
            a.quadrature_degree is not None,
        ),
        radius if radius is None or isinstance(radius, str) else float(radius),
        a.constraints,
        a.augmented,
        float(a.gap_tolerance),
        a.sliding,
        (has_creases(slave, at_points), has_creases(master, at_points)),
        (_sharp(slave, at_points), _sharp(master, at_points)),
        a.name,
    )
    return dataclasses.replace(settings, reach=_reach(settings, a.penalty))


def _reach(settings: Settings, penalty: float | str) -> float | None:
    """Opening beyond which a user's law gives no multiplier; None if unknown. Collective."""
    law = settings.law
    if type(law) in BUILT_IN or settings.type is not ContactType.NORMAL or penalty == "auto":
        return None
    found = law_samples.reach(law, float(penalty), settings.largest_facet) or 0.0
    return float(settings.slave.comm.allreduce(found, op=MPI.MAX)) or None


def _sharp(surface: AnySurface, asked: bool) -> SharpNodes | None:
    """Sharp vertices of a body; None of a tool, or if ``asked`` is False. Collective."""
    return next((SharpNodes.of(body) for body in surface.bodies if asked), None)
