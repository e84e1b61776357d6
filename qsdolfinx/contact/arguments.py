"""What a contact cannot be made of."""

from __future__ import annotations

import typing

from mpi4py import MPI

from dolfinx import fem

from qsdolfinx.base.checks import check, either, instance, require
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.laws import Law
from qsdolfinx.pairing.relief import Side
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, deformable

SLAVE = instance(Surface, "a qsdolfinx.Surface; a rigid tool can be the master only")
MASTER = instance(Surface | RigidSurface, "a qsdolfinx.Surface, or a rigid tool")


def check_surfaces(slave: typing.Any, master: typing.Any) -> None:
    """Refuse surfaces that cannot be in contact."""
    check(SLAVE, slave=slave)
    check(MASTER, master=master)
    same = slave.gdim == master.gdim
    require(same, "slave and master have different geometric dimensions")
    same = MPI.Comm.Compare(slave.comm, master.comm) in (MPI.IDENT, MPI.CONGRUENT)
    require(same, "slave and master: the meshes must be on the same ranks in the same order")
    other = deformable(master)
    if other is not None:
        slave.check_partner(other)


def default_enforcement(formulation: str) -> str:
    """An augmented Lagrangian, but where there is none."""
    return "penalty" if formulation == "double-pass" else "augmented-lagrangian"


def check_formulation(formulation: str, enforcement: str, master: AnySurface) -> None:
    """Refuse multipliers where they cannot be."""
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
    """Refuse constraints at points where nodes are what counts."""
    if constraints == "nodes":
        return
    require(quadrature == "overlay", 'constraints: "points" needs quadrature="overlay"')
    require(
        not law.jump,
        'constraints: tied contact is over-constrained at "points"; use "nodes"',
    )


def check_smoothing(sides: tuple[Side, Side], quadrature: str) -> None:
    """Refuse smoothing where the gap is not measured between facets."""
    require(
        sides == (None, None) or quadrature == "overlay",
        "smoothing: nodal quadrature does not measure the gap of the facets between nodes; "
        'use quadrature="overlay"',
    )


def check_sliding(
    sliding: str, quadrature: str, normals: str, constraints: str, sides: tuple[Side, Side]
) -> None:
    """Refuse what is not defined where contact follows the bodies."""
    if sliding == "small":
        return
    of = 'sliding: "finite" '
    require(
        quadrature == "overlay",
        of + "cuts facets along each other: at nodes a closest point that moves would make forces "
        'jump from facet to facet; use quadrature="overlay"',
    )
    require(normals == "facet", of + 'measures gaps along normals of facets; leave out "normals"')
    require(constraints == "nodes", of + 'has constraints at "nodes"')
    require(sides == (None, None), of + "measures gaps between facets; leave out smoothing")


def check_itself(
    formulation: str,
    quadrature: str,
    law: Law,
    sides: tuple[Side, Side],
    unknown: str | typing.Sequence[str],
) -> None:
    """Refuse what is not defined for a surface that touches itself."""
    of = "contact of a surface with itself "
    require(
        formulation != "double-pass",
        f'formulation: {of}gives roles to pairs of facets; use "quasi-symmetric"',
    )
    require(
        quadrature == "overlay",
        f'quadrature: {of}is decided facet by facet; use quadrature="overlay"',
    )
    require(not law.jump, f"law: {of}cannot be tied; name the two parts as surfaces")
    require(sides == (None, None), f"smoothing: {of}measures gaps between facets")
    alike = isinstance(unknown, str) or len(set(unknown)) == 1
    require(alike, f"unknown: {of}has one body, with one kind of unknowns")


def check_friction(friction: typing.Any, slave: Surface) -> None:
    """Refuse friction of another type, or with parameters of another mesh."""
    check(either(instance(Friction, "such as qs.Coulomb(0.2)"), None), friction=friction)
    for name, value in friction.parameters.items() if friction is not None else ():
        fits = not isinstance(value, fem.Function) or value.function_space.mesh is slave.mesh
        require(fits, f"friction: {name}: the Function must be on the mesh of the slave")


def check_friction_use(friction: Friction | None, penalty: float | None, law: Law) -> None:
    """Refuse a penalty of no friction, and friction of tied contact."""
    require(friction is not None or penalty is None, "friction_penalty: needs friction")
    slips = friction is None or not law.jump
    require(slips, "friction: tied contact sticks already; leave it out, or use Unilateral()")
