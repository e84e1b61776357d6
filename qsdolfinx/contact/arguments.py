"""Checks of the arguments of a contact."""

from __future__ import annotations

import typing

from mpi4py import MPI

from dolfinx import fem

from qsdolfinx.base.checks import FINITE, check, either, instance, require
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.laws import Conductance, Law, Tied, Unilateral
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, is_rigid

SLAVE = instance(Surface, "a qsdolfinx.Surface; a rigid tool can be the master only")
MASTER = instance(Surface | RigidSurface, "a qsdolfinx.Surface, or a rigid tool")


def check_surfaces(slave: typing.Any, master: typing.Any) -> None:
    """Raise an error for surfaces that cannot be in contact."""
    check(SLAVE, slave=slave)
    check(MASTER, master=master)
    same = slave.gdim == master.gdim
    require(same, "slave and master have different geometric dimensions")
    same = MPI.Comm.Compare(slave.comm, master.comm) in (MPI.IDENT, MPI.CONGRUENT)
    require(same, "slave and master: the meshes must be on the same ranks in the same order")
    for body in master.bodies:
        slave.check_partner(body)


def default_enforcement(formulation: str, law: typing.Any) -> str:
    """Default of ``enforcement``: augmented Lagrangian wherever it is available.

    A law of the user's gives λ = φ'(ḡ), which is not that of a multiplier, λ = φ'(ḡ + λ/ε).
    """
    exact = formulation != "double-pass" and type(law) in (Unilateral, Tied)
    return "augmented-lagrangian" if exact or not isinstance(law, Law) else "penalty"


def default_constraints(
    quadrature: str, formulation: str, law: Law, enforcement: str, sliding: str
) -> str:
    """Default of ``constraints``: points where available; a user's law needs multipliers there."""
    points = quadrature == "overlay" and formulation != "double-pass" and not law.memory
    points &= enforcement == "augmented-lagrangian" or type(law) is Unilateral
    points |= sliding == "finite"
    return "points" if points and not law.jump else "nodes"


class Given(typing.NamedTuple):
    """Arguments of :class:`qs.Contact` that must have their defaults for scalar fields."""

    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    unknown: typing.Any = "displacement"
    sliding: str | None = None
    initial_overclosure: str = "resolve"
    constraints: str | None = None


def check_field(
    slave: Surface,
    master: AnySurface,
    law: Law,
    enforcement: str,
    friction: typing.Any,
    penalty: float | str,
    given: Given,
) -> None:
    """Raise an error for options that scalar fields do not have, or that only they have."""
    conducts = isinstance(law, Conductance)
    if not slave.is_scalar:
        require(not conducts, "law: Conductance is for surfaces on scalar spaces")
        return
    require(law.jump, "law: scalar fields have no gaps; use qs.Tied() or qs.Conductance(h)")
    both = given.formulation == "double-pass"
    text = "formulation: scalar fields have one multiplier"
    require(not both, f'{text}; use "quasi-symmetric" or "master-slave"')
    require(friction is None, "friction: scalar fields have none; see qs.Conductance(friction=)")
    for name in ("unknown", "sliding", "initial_overclosure", "constraints"):
        fits = getattr(given, name) == getattr(Given(), name)
        fits = fits or (name, given.constraints) == ("constraints", "nodes")
        require(fits, f"{name}: leave it out; scalar fields have no motion")
    if conducts:
        text = "has no multiplier and no penalty, since h takes its place; leave it out"
        require(enforcement == "penalty", f"enforcement: a conductance {text}")
        require(penalty == "auto", f"penalty: a conductance {text}")
    tool, conductance = is_rigid(master), law if conducts else None
    if tool:
        text = "use qs.Conductance(h, tool=…), or Dirichlet conditions for a tool's temperature"
        require(conductance is not None, f"law: a rigid tool has no field to be tied to; {text}")
    known = isinstance(conductance, Conductance) and conductance.tool is not None
    require(known == tool, "law: Conductance needs tool=, its temperature, for rigid tools only")


_OF = "leave it out; the contact in mechanics determines it"


def check_of_use(
    slave: Surface, law: Law, of: typing.Any, given: Given, shares: bool, **search: typing.Any
) -> None:
    """Raise an error if ``mechanics`` is missing, or given without use.

    Options of contact detection are not allowed either if the field uses the bodies' contact pairs.
    """
    needed = isinstance(law, Conductance) and (law.of_state or law.friction is not None)
    if of is None:
        require(
            not needed, "mechanics: must be the bodies' contact, for h(p, g) or heat of friction"
        )
        return
    require(slave.is_scalar, "mechanics: is for surfaces on scalar spaces")
    require(hasattr(of, "model"), "mechanics: must be a qsdolfinx.Contact", TypeError)
    for name in ("formulation", "quadrature") if shares else ():
        theirs = {"formulation": of.model.settings.formulation}
        theirs["quadrature"] = of.model.settings.sampling.quadrature
        fits = getattr(given, name) in (getattr(Given(), name), theirs[name])
        require(fits, f"{name}: {_OF}")
    for name, value in search.items() if shares else ():
        require(value is None, f"{name}: {_OF}")
    heats = isinstance(law, Conductance) and law.friction is not None
    text = "mechanics: the bodies' contact has no friction; leave out friction= of the conductance"
    require(not heats or of.friction is not None, text)


def check_formulation(formulation: str, enforcement: str, master: AnySurface) -> None:
    """Raise an error for double-pass contact with a rigid tool, or with an augmented Lagrangian."""
    both = formulation == "double-pass"
    require(
        not both or master.V is not None,
        "formulation: double-pass needs a multiplier on both sides, and a rigid tool has none; "
        'use "master-slave" or "quasi-symmetric"',
    )
    require(
        not both or enforcement == "penalty",
        "enforcement: the multipliers of double-pass contact, on both sides, cannot close every "
        'gap of non-matching meshes; use "penalty", or formulation="quasi-symmetric"',
    )


def check_constraints(constraints: str, quadrature: str, law: Law) -> None:
    """Raise an error for constraints at points with nodal quadrature or tied contact."""
    if constraints == "nodes":
        return
    require(quadrature == "overlay", 'constraints: "points" needs quadrature="overlay"')
    require(
        not law.jump,
        'constraints: tied contact is over-constrained at "points"; use "nodes"',
    )


def check_memory(
    law: Law, friction: Friction | None, enforcement: str, penalty: typing.Any
) -> None:
    """Raise an error for laws with history variables that the other arguments do not support."""
    of = "a law that remembers "
    for what, each, base in (("law", law, Law), ("friction", friction, Friction)):
        if each is None or not each.memory:
            continue
        numbers = isinstance(each.memory, typing.Mapping) and all(
            isinstance(name, str) and FINITE.fits(first) for name, first in each.memory.items()
        )
        require(
            numbers, f"{what}: memory must have a name and a finite initial value of each number"
        )
        commits = type(each).commit is not base.commit
        require(commits, f"{what}: {of}needs commit, which returns its memory after a step")
    if not law.memory:
        return
    same = set(law.memory) & set(() if friction is None else friction.memory)
    require(
        not same, f"friction: its memory and that of the law need other names, not {sorted(same)}"
    )
    require(enforcement == "penalty", f'enforcement: {of}uses gap and ε only; use "penalty"')
    text = f"penalty: {of}needs a number, as ε is a part of it"
    require(penalty != "auto", f'{text}; "auto" differs on each mesh')


def check_sliding(
    sliding: str,
    quadrature: str,
    normals: str,
    constraints: str,
    law: Law,
) -> None:
    """Raise an error for arguments that are not available with finite sliding."""
    if sliding == "small":
        return
    of = 'sliding: "finite" '
    require(
        quadrature == "overlay",
        of + "needs the segmentation of facets: with closest points of nodes, forces would jump "
        'from facet to facet; use quadrature="overlay"',
    )
    require(normals == "facet", of + 'measures gaps along normals of facets; leave out "normals"')
    at_points = law.jump or constraints == "points"
    require(at_points, f'constraints: {of}asks the law at points; leave out constraints="nodes"')


def check_itself(
    formulation: str,
    quadrature: str,
    law: Law,
    unknown: str | typing.Sequence[str],
) -> None:
    """Raise an error for arguments that are not available for self-contact."""
    of = "contact of a surface with itself "
    require(
        formulation != "double-pass",
        f'formulation: {of}gives roles to pairs of facets; use "quasi-symmetric"',
    )
    require(
        quadrature == "overlay",
        f'quadrature: {of}is decided facet by facet; use quadrature="overlay"',
    )
    require(not law.jump, f"law: {of}cannot be tied; give the two parts as two surfaces")
    alike = isinstance(unknown, str) or len(set(unknown)) == 1
    require(alike, f"unknown: {of}has one body, with one kind of unknowns")


def check_friction(friction: typing.Any, slave: Surface) -> None:
    """Raise an error for friction of another type, or with parameters on another mesh."""
    check(either(instance(Friction, "a law such as qs.Coulomb(0.2)"), None), friction=friction)
    for name, value in friction.parameters.items() if friction is not None else ():
        fits = not isinstance(value, fem.Function) or value.function_space.mesh is slave.mesh
        require(fits, f"friction: {name}: the Function must be on the mesh of the slave")


def check_friction_use(friction: Friction | None, penalty: float | None, law: Law) -> None:
    """Raise an error for a friction penalty without friction, or friction of tied contact."""
    require(friction is not None or penalty is None, "friction_penalty: needs friction")
    slips = friction is None or not law.jump
    require(slips, "friction: tied contact sticks already; leave it out, or use Unilateral()")
