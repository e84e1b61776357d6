"""The parts of a contact, as solvers see them."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact.penalty import Penalty
from qsdolfinx.contact.placement import Placement
from qsdolfinx.friction.history import FrictionHistory
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.facet_cutter import FacetCutter, Overlay
from qsdolfinx.gap.following import Cutter, Following
from qsdolfinx.gap.friction_heat import FrictionHeat
from qsdolfinx.gap.kinematics import Kinematics
from qsdolfinx.gap.laws import Law, Unilateral
from qsdolfinx.gap.overclosure import Overclosure
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.shape_points import ShapePoints
from qsdolfinx.gap.vertex_points import ToolVertices, Vertices
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.crossings import EdgesRole, pair_edges
from qsdolfinx.pairing.edges import edges_of
from qsdolfinx.pairing.pair import Sampling, pair, share_out_hardly_covered
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.pairing.relief import check_curved
from qsdolfinx.pairing.vertices import VerticesRole, pair_vertices
from qsdolfinx.surface.affine import Affine
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, as_tool, deformable

T = typing.TypeVar("T")

#: Gaps smaller than this part of the smallest facet count as closed.
TOUCHING = 1e-12

#: Part of multipliers that points see, below which they see none.
LEAST_PART = 1e-3

#: Largest facets that bodies may be within each other where contact follows them.
FOLLOWING_REACH = 4.0

#: Blocks ss, sm, ms, mm of the slave's and the master's body.
BlocksOf = tuple[PETSc.Mat | None, PETSc.Mat | None, PETSc.Mat | None, PETSc.Mat | None]

#: A part with multipliers: the gap of a pass, or its slip.
Part = WeightedGap | Slip


@dataclasses.dataclass(frozen=True)
class Settings:
    """What a contact was made with and keeps; see :class:`qs.Contact`.

    Attributes:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        formulation: Which surfaces are sampled, and which carry multipliers.
        law: From the gap to the multiplier.
        sampling: Where the gap is sampled.
        search_radius: Length; None for the largest facet, or ``"local"`` for the size of the facets
            there, at each pairing.
        constraints: Whether the law is asked at ``"nodes"``, or at the pairing ``"points"``.
        augmented: Whether the multiplier is augmented until the gap is closed.
        gap_tolerance: Gap at which augmentation ends, in units of the smallest facet.
        sliding: ``"small"`` or ``"finite"``: whether contact's geometry follows the bodies.
        sharp: Whether vertices at creases of the slave's, and of the master's, have pairs of their
            own; see :func:`pair_vertices`.
    """

    slave: Surface
    master: AnySurface
    formulation: str
    law: Law
    sampling: Sampling
    search_radius: float | str | None
    constraints: str
    augmented: bool
    gap_tolerance: float
    sliding: str = "small"
    sharp: tuple[bool, bool] = (False, False)

    @property
    def rows(self) -> str:
        """What the rows of the gaps are, see :class:`WeightedGap`."""
        if self.constraints == "points":
            return "points"
        return "cover" if self.sampling.quadrature == "overlay" else "area"

    @property
    def facet_size(self) -> float:
        """Of the smallest facet, length."""
        with_facets = [s for s in (self.slave, self.master) if not s.is_analytic]
        return min(s.facet_size_range[0] for s in with_facets)

    @property
    def roles(self) -> list[tuple[Surface, AnySurface]]:
        """Slave and master of each pass."""
        first: tuple[Surface, AnySurface] = (self.slave, self.master)
        master = deformable(self.master)
        if self.formulation != "double-pass" or master is None:
            return [first]
        return [first, (master, self.slave)]

    @property
    def roles_of_vertices(self) -> list[VerticesRole]:
        """The same of the passes of vertices at creases."""
        master = deformable(self.master)
        out = [VerticesRole(self.slave, self.master, of_tool=False)] if self.sharp[0] else []
        if self.sharp[1] and master is not None:
            out.append(VerticesRole(master, self.slave, of_tool=False))
        elif self.sharp[1] and (self.sliding == "small" or self.slave.gdim == 2):
            out.append(VerticesRole(self.slave, self.master, of_tool=True))
        return out

    @property
    def roles_of_edges(self) -> list[EdgesRole]:
        """The same of the passes of creases in 3D."""
        if self.master.is_analytic or self.slave.gdim == 2 or self.sliding == "finite":
            return []
        slave, master, other = self.slave, self.master, deformable(self.master)
        roles = [EdgesRole(slave, master, (True, True))] if all(self.sharp) else []
        if self.sharp[0]:
            below = (
                (slave, master, (True, False)) if other is None else (other, slave, (False, True))
            )
            roles.append(EdgesRole(*below))
        if self.sharp[1]:
            roles.append(EdgesRole(slave, master, (False, True)))
        return roles


@dataclasses.dataclass(frozen=True)
class Paired:
    """What one pairing has found; of its parts only the states change.

    Attributes:
        gaps: Weighted gap of each pass: of the sides with multipliers, then of vertices at creases.
        slips: Slip of each pass; none without friction.
        radius: Distance (length) beyond which points were not paired.
        facet_size: Of the smallest facet, length.
        tool_version: Position of a rigid tool that it was paired with.
    """

    gaps: tuple[WeightedGap, ...]
    slips: tuple[Slip, ...]
    radius: _cpp.SearchRadius
    facet_size: float
    tool_version: int

    @property
    def touching(self) -> float:
        """Gap (length) that counts as closed."""
        return TOUCHING * self.facet_size

    @property
    def search_radius(self) -> float:
        """Distance (length) beyond which nothing was paired anywhere."""
        return self.radius.largest

    @property
    def parts(self) -> tuple[Part, ...]:
        """All that has multipliers: gaps of the passes, then their slips."""
        return (*self.gaps, *self.slips)


@dataclasses.dataclass(frozen=True)
class HeldNodes:
    """Nodes of a pass whose distance conditions prescribe.

    Attributes:
        gap: The pass.
        at_nodes: The gaps of its nodes themselves, without those around.
        components: What is held of them, of the shape of these gaps.
    """

    gap: WeightedGap
    at_nodes: WeightedGap
    components: npt.NDArray[np.bool_]


@dataclasses.dataclass
class HeldSlip:
    """Components of the nodes of a slip that conditions hold on both sides.

    Attributes:
        slip: The slip.
        by_node: Its pass with a row for each node.
        held: The components, shape (rows, block).
        clamped: Those of them at nodes that are held as a whole, of the same shape.
        at_nodes: The gaps of vertices themselves, without those around.
        of_master: Nonzero at the unknowns of the master's body that have conditions; None of a
            rigid tool.
        redundant: Those of ``held`` that are no unknowns at present; None before that is known.
    """

    slip: Slip
    by_node: WeightedGap
    held: npt.NDArray[np.bool_]
    clamped: npt.NDArray[np.bool_]
    at_nodes: WeightedGap
    of_master: npt.NDArray[np.float64] | None
    redundant: npt.NDArray[np.bool_] | None = None


@dataclasses.dataclass(frozen=True)
class OverclosedStart:
    """Where slave nodes that penetrate were when contact was first paired.

    Attributes:
        nodes: Which of this rank, shape (nodes,).
        x: Where they were as the master saw them, of the shape (such nodes, 3).
        normal: Their normals, of the same shape.
    """

    nodes: npt.NDArray[np.bool_]
    x: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]


def find_pairs(
    settings: Settings,
    friction: FrictionHistory | None,
    known: _cpp.PairingPoints | None = None,
) -> Paired:
    """Pair the surfaces where they are now. Collective.

    Args:
        settings: What the contact was made with.
        friction: None without.
        known: Pairing points of its one pass; None if they are to be found.
    """
    slave, master = settings.slave, settings.master
    bodies = [s for s in (slave, deformable(master)) if s is not None]
    check_curved(bodies, settings.sampling.quadrature, not master.is_analytic)
    radius = radius_of(settings)
    roles = settings.roles
    both = settings.formulation == "quasi-symmetric"
    corners = not settings.law.jump  # one pair ties a node in all directions
    points = [] if known is None else [known]
    if known is None:
        points = [pair(*role, settings.sampling, both, radius, corners) for role in roles]
    if settings.augmented and known is None and settings.rows != "points":
        for (first, _), found in zip(roles, points, strict=True):
            share_out_hardly_covered(first, found)
    gaps = tuple(
        WeightedGap(
            first,
            second,
            found,
            settings.law,
            1 / len(roles),
            rows=settings.rows,
            augmented=settings.augmented or settings.rows == "points",
            following=_following(settings, first, second, radius),
            turns=settings.sliding if settings.law.jump else None,
        )
        for (first, second), found in zip(roles, points, strict=True)
    )
    gaps += _at_creases(settings, radius)
    slips = () if friction is None else friction.slips_of(gaps)
    return Paired(gaps, slips, radius, settings.facet_size, master.version)


def _at_creases(settings: Settings, radius: _cpp.SearchRadius) -> tuple[WeightedGap, ...]:
    """The passes of vertices, then of edges. Collective."""
    of_edges = settings.roles_of_edges
    edges = {s: edges_of(s) for s in (settings.slave, settings.master)} if of_edges else {}
    passes = [
        (role.slave, role.master, pair_vertices(role, radius), role.of_tool)
        for role in settings.roles_of_vertices
    ]
    passes += [
        (*role[:2], pair_edges(role, (edges[role.slave], edges[role.master]), radius), False)
        for role in of_edges
    ]
    return tuple(
        WeightedGap(
            slave,
            master,
            points,
            settings.law,
            1.0,
            rows="points",
            augmented=True,
            following=_following(settings, slave, master, radius, "tool" if of_tool else "slave"),
        )
        for slave, master, points, of_tool in passes
    )


def _following(
    settings: Settings,
    slave: Surface,
    master: AnySurface,
    radius: _cpp.SearchRadius,
    vertices_of: str | None = None,
) -> Following | None:
    """What makes gaps of a pass follow the bodies; None where they are linear. Collective.

    Args:
        settings: Of the contact.
        slave: The slave of the pass.
        master: Its master.
        radius: Beyond which points are not paired.
        vertices_of: Whose vertices are the points: ``"slave"``, ``"tool"``, or None for facets.
    """
    if settings.sliding == "small" or settings.law.jump:
        return None
    tool, degree = as_tool(master), settings.sampling.degree
    cutter: Cutter
    if tool is not None and tool.is_analytic:
        cutter = ShapePoints(slave, tool, radius.largest, None if vertices_of else degree)
    elif vertices_of == "tool":
        assert tool is not None
        cutter = FacetCutter(slave, master, ToolVertices(slave, tool, radius))
    elif vertices_of == "slave":
        cutter = FacetCutter(slave, master, Vertices(slave, master, radius))
    else:
        # Points of the slave's facets see all of a tool's shape.
        both = settings.formulation == "quasi-symmetric" and tool is None
        cutter = FacetCutter(slave, master, Overlay(slave, both, radius, degree))
    return Following(slave, master, radius.largest, cutter)


def radius_of(settings: Settings) -> _cpp.SearchRadius:
    """How far from each other points may be that are paired. Collective.

    By default the largest facet, as bodies that are pressed come closer to each other all over what
    is going to touch. A tool's triangles may be as large as it is flat: they do not count. Where
    gaps follow the bodies, iterates of Newton's method must not lose each other: it is more.
    """
    if isinstance(settings.search_radius, float):
        return _cpp.SearchRadius(settings.search_radius)
    slave, master = settings.slave, settings.master
    largest = slave.facet_size_range[1]
    if as_tool(master) is None:
        largest = max(largest, master.facet_size_range[1])
    if settings.sliding == "finite":
        largest *= FOLLOWING_REACH
    local = settings.search_radius == "local" and not master.is_analytic
    return _cpp.SearchRadius(largest, by_size=local)


class Mechanics(typing.Protocol):
    """What a scalar field takes from the contact of its bodies: see ``contact.across``.

    Attributes:
        of: The bodies' contact.
        shares_pairs: Whether the field has the bodies' pairs.
        at_points: The bodies' gaps at their pairing points, if it has.
    """

    of: ContactModel
    shares_pairs: bool
    at_points: PointRows

    @property
    def is_stale(self) -> bool:
        """Whether the bodies have been paired anew since :meth:`points`."""

    def points(self) -> _cpp.PairingPoints:
        """The bodies' pairing points with the unknowns of the field. Collective."""

    def pressure(self) -> npt.NDArray[np.float64]:
        """Pressure at the points, or at the slave's nodes. Collective."""

    def distance(self) -> npt.NDArray[np.float64]:
        """Distance at the points. Collective."""

    def dissipation(self) -> npt.NDArray[np.float64]:
        """Energy of friction at the slave's nodes. Collective."""

    def rows_at_points(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Values of the bodies' rows at the points' functions. Collective."""


class Coupling(typing.Protocol):
    """What conductances add to the tangent as they change: see ``contact.coupling``."""

    @property
    def of_bodies(self) -> ContactModel | None:
        """The bodies' contact, if its multipliers are unknowns beside those of the field."""

    def add_to(self, blocks: BlocksOf, pattern: bool) -> None:
        """Add to the blocks ss, sm, ms, mm. Collective."""

    def by_multipliers(self) -> list[PETSc.Mat]:
        """Derivatives of each side's flow by λ̂ at the rows of the bodies' gaps. Collective."""

    def destroy(self) -> None:
        """Free what it has. Collective."""


class ContactModel:
    """What the terms of a contact are functions of.

    Args:
        settings: What it was made with.
        kinematics: How unknowns move its surfaces.
        penalty: ε.
        overclosure: What becomes of initial penetration.
        friction: None without.
        mechanics: Of a scalar field, the contact of the bodies; None if it needs none.
    """

    def __init__(
        self,
        settings: Settings,
        kinematics: Kinematics,
        penalty: Penalty,
        overclosure: Overclosure,
        friction: FrictionHistory | None,
        mechanics: Mechanics | None = None,
    ) -> None:
        self.settings = settings
        self.kinematics = kinematics
        self.penalty = penalty
        self.overclosure = overclosure
        self.friction = friction
        self.mechanics = mechanics
        #: What messages call it; None for its place among the problem's contacts.
        self.name: str | None = None
        #: Kinds of findings that were told of it, see :mod:`qsdolfinx.contact.findings`.
        self.told: set[str] = set()
        #: Heat of friction of the bodies, as a load of temperatures; None without.
        self.friction_heat: FrictionHeat | None = None
        #: ``num_pairings`` at the last evaluation.
        self.evaluated_at = 0
        #: Whether gaps have been evaluated: before that there are no forces.
        self.is_evaluated = False
        #: What the last evaluation has left, if parts are others since: see ``contact.shown``.
        self.kept: ContactModel | None = None
        #: Minus the least, and the largest value of a scalar field at the slave's rows here.
        self.field_range: npt.NDArray[np.float64] = np.zeros(2)
        #: What conductances were functions of at the last evaluation, at the points.
        self.conduction_state: tuple[npt.NDArray[np.float64], ...] = ()
        #: Whether the bodies' contact is one of the same bodies, whose unknowns are mixed.
        self.with_bodies = False
        #: What conductances add to the tangent as they change; None for nothing.
        self.coupling: Coupling | None = None
        #: Whether ``sliding`` is left to the problem, see :mod:`qsdolfinx.contact.chosen_sliding`.
        self.sliding_is_open = False
        #: Whether the user has named the kind of sliding.
        self.sliding_is_given = False
        #: What the last pairing found; see :func:`qsdolfinx.contact.motion.pair_anew`.
        self.paired: Paired
        #: Where the surfaces are at the last evaluation.
        self.placement: Placement
        #: Motion of a rigid tool that gaps follow, from where it was paired; None for none.
        self.tool_motion: Affine | None = None
        #: What :mod:`qsdolfinx.contact.depth` has measured of a placement.
        self.measured: object | None = None
        #: Counts the pairings made so far.
        self.num_pairings = 0
        #: Displacements (length) on top of the unknowns', of the slave's and the master's
        #: body; see :meth:`qs.Contact.set_offset`.
        self.offset: tuple[PETSc.Vec | None, PETSc.Vec | None] | None = None
        #: Pairs where a time step has left the bodies; None if nothing has to be caught up with.
        self.catch_up: typing.Callable[[], None] | None = None
        #: Where slave nodes penetrated at first, as long as that is watched as bodies slide.
        self.overclosed_from: OverclosedStart | None = None
        #: Says which problem it is part of, None once that is gone; None before it is part of any.
        self.problem: typing.Callable[[], object] | None = None
        #: Errors of the gaps at the slave's nodes by chord errors (length); None before any solve.
        self.chord_gaps: npt.NDArray[np.float64] | None = None
        #: Nodes whose distance conditions prescribe; see :func:`qsdolfinx.contact.held.find`.
        self.held_nodes: list[HeldNodes] = []
        #: What conditions hold of slips; see :func:`qsdolfinx.contact.held.begin_solve`.
        self.held_slips: list[HeldSlip] = []
        #: Whether conditions hold the slave, and the master, where they leave the other side free.
        self.held_alone = (False, False)
        #: Wall time that this rank has spent in pairing, gaps and insertion.
        self.watch = Stopwatch()

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.settings.slave

    @property
    def master(self) -> AnySurface:
        """The other surface, or a rigid tool."""
        return self.settings.master

    @property
    def is_scalar(self) -> bool:
        """Whether it is of scalar fields, such as temperatures, which move nothing."""
        return self.slave.is_scalar

    @property
    def with_itself(self) -> bool:
        """Whether slave and master are one and the same boundary."""
        return self.slave.key is not None

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.slave.comm

    @property
    def law(self) -> Law:
        """From the gap to the multiplier."""
        return self.settings.law

    @property
    def augmented(self) -> bool:
        """Whether the multiplier is augmented until the gap is closed."""
        return self.settings.augmented

    @property
    def gaps(self) -> tuple[WeightedGap, ...]:
        """Weighted gap of each pass: of the sides with multipliers, then of vertices at creases."""
        return self.paired.gaps

    @property
    def of_sides(self) -> tuple[WeightedGap, ...]:
        """Those of the sides with multipliers."""
        return self.paired.gaps[: len(self.settings.roles)]

    @property
    def pairings(self) -> list[Pairing]:
        """Pairing points of every pass: two for double-pass contact, otherwise one."""
        return [Pairing.from_cpp(gap.points) for gap in self.of_sides]

    @property
    def of_vertices(self) -> tuple[WeightedGap, ...]:
        """Those of vertices at creases."""
        return self.paired.gaps[len(self.settings.roles) :]

    @property
    def slips_of_vertices(self) -> tuple[Slip, ...]:
        """Their slips; none without friction."""
        return self.slips[len(self.settings.roles) :]

    @property
    def slips(self) -> tuple[Slip, ...]:
        """Slip of each pass; none without friction."""
        return self.paired.slips

    @property
    def parts(self) -> tuple[Part, ...]:
        """All that has multipliers: gaps of the passes, then their slips."""
        return self.paired.parts

    def take_parts(self, gaps: tuple[WeightedGap, ...], slips: tuple[Slip, ...]) -> None:
        """Replace gaps and slips by others of the same pairing."""
        self.paired = dataclasses.replace(self.paired, gaps=gaps, slips=slips)

    @property
    def eps(self) -> float:
        """ε, or γ of multipliers at points, as a number (stress per length).

        γ is the automatic penalty, whatever is given: what multipliers cannot follow of the gaps
        within a facet resists with it. A softer penalty than that has no multipliers there.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        given, usual = self.penalty.eps, self.penalty.of_points
        return usual if self.has_multipliers_at_points and usual is not None else given

    @property
    def has_multipliers_at_points(self) -> bool:
        """Whether constraints at points have λ: not of a penalty as soft as the bodies.

        Nor of double-pass contact that follows the bodies: two fields of multipliers for the same
        gaps, at other points in each iteration, are not determined.
        """
        if self.settings.constraints != "points" or self.augmented:
            return self.settings.constraints == "points"
        usual, given = self.penalty.of_points, self.penalty.eps
        if self.settings.formulation == "double-pass" and self.follows:
            return False
        if usual is None or type(self.law) is not Unilateral:
            return False
        return given * (1 - LEAST_PART) > usual

    @property
    def part_of_multipliers(self) -> float:
        """What points see of multipliers: 1, or less of a penalty that is their compliance."""
        exact = self.augmented or not self.has_multipliers_at_points
        return 1.0 if exact else 1 - self.eps / self.penalty.eps

    @property
    def stiffness_ratio(self) -> float:
        """Penalty over stiffness of the softer side; 0 if either is not known."""
        ratio = self.penalty.ratio
        return ratio * self.eps / self.penalty.eps if ratio > 0 else 0.0

    @property
    def tangential_eps(self) -> float:
        """ε in tangential direction; only with friction."""
        assert self.friction is not None
        return self.friction.penalty(self.eps if self.augmented else self.penalty.eps)

    @property
    def slip_penalty(self) -> tuple[float, float]:
        """What makes stress of slips at points: γ_t (stress per length), and γ_t/ε_t of a penalty.

        γ_t is ε_t, but no more than an automatic one has: a stiffer one, with which the sense of
        slip changes in each iteration, decides nothing but how points differ from their nodes. The
        second number is 0 of an augmented Lagrangian.
        """
        eps, usual = self.tangential_eps, self.penalty.of_slips
        gamma = eps if usual is None else min(eps, usual)
        return gamma, 0.0 if self.augmented else gamma / eps

    @property
    def compliance(self) -> float:
        """Gap that a pressure at a node closes, over it: of the penalty and of the bodies."""
        of_bodies = sum(1 / k for k in self.penalty.stiffness if k > 0)
        return of_bodies + (0.0 if self.augmented else 1 / self.penalty.eps)

    @property
    def allowed_gap(self) -> float:
        """Gap (length) that multipliers may leave open."""
        return self.settings.gap_tolerance * self.paired.facet_size

    @property
    def follows(self) -> bool:
        """Whether gaps are found anew at each evaluation."""
        return any(gap.following is not None for gap in self.gaps)

    @property
    def is_linear(self) -> bool:
        """Whether gaps are linear functions of the unknowns."""
        return all(gap.is_linear for gap in self.gaps)

    @property
    def symmetric(self) -> bool:
        """Whether what contact adds to the tangent is symmetric."""
        if self.coupling is not None or self.follows:  # functions of nodes move
            return False
        first, second = self.kinematics.scale
        equal = first == second
        law = None if self.friction is None else self.friction.law
        if law is None or not equal:
            return equal
        # At points a limit that jumps goes with the pressure where that is next to none.
        goes = law.jumps and any(slip.gap.rows.are_points for slip in self.slips)
        return law.symmetric and not goes

    def called(self, number: int) -> str:
        """What messages call it: by its name, or by its number among the problem's contacts."""
        return f"contact {number if self.name is None else repr(self.name)}"

    def ordered(self, gap: WeightedGap, of_bodies: tuple[T, T]) -> tuple[T, T]:
        """Things of the slave's and the master's body in the order of a pass."""
        return of_bodies if gap.slave is self.slave else (of_bodies[1], of_bodies[0])
