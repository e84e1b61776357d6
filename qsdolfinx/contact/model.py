"""The parts of a contact, as used by solvers."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.penalty import Penalty
from qsdolfinx.contact.placement import Placement
from qsdolfinx.friction.history import FrictionHistory
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.facet_cutter import FacetCutter, Overlay
from qsdolfinx.gap.following import Cutter, Following, follows
from qsdolfinx.gap.friction_heat import FrictionHeat
from qsdolfinx.gap.kinematics import Kinematics
from qsdolfinx.gap.laws import Law, Unilateral
from qsdolfinx.gap.overclosure import Overclosure
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.shape_points import ShapePoints
from qsdolfinx.gap.vertex_points import ToolVertices, Vertices
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.crossings import EdgesRole, pair_edges
from qsdolfinx.pairing.curved import check_curved
from qsdolfinx.pairing.edges import edges_of
from qsdolfinx.pairing.facets import SharpNodes
from qsdolfinx.pairing.pair import Sampling, pair, share_out_hardly_covered
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.pairing.vertices import VerticesRole, pair_vertices
from qsdolfinx.surface.affine import Affine
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid, is_shape

T = typing.TypeVar("T")

#: Part of the multipliers acting at points below which they do not act at points. Forces would be
#: this part of a difference between two nearly equal compliances.
LEAST_PART = 1e-3

#: Search distance with finite sliding, in units of the largest facet. With 1, iterates lose their
#: contact pairs; a large distance finds the far sides of bodies, and takes time.
FOLLOWING_REACH = 4.0

#: Search distance over the opening at which a law ends: surfaces part further in a step before they
#: are pulled back.
BEYOND_REACH = 2.0

#: Blocks ss, sm, ms, mm of the slave's and the master's body.
BlocksOf = tuple[PETSc.Mat | None, PETSc.Mat | None, PETSc.Mat | None, PETSc.Mat | None]

#: A part with multipliers: the gap of an integration side, or its slip.
Part = WeightedGap | Slip


@dataclasses.dataclass(frozen=True)
class Settings:
    """Constant settings of a contact; see :class:`qs.Contact`.

    Attributes:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        formulation: Which surfaces are sampled, and which carry multipliers.
        law: Contact law: multiplier as a function of the gap.
        sampling: Where the gap is sampled.
        search_radius: Search distance (length); None for the size of the largest facet. ``"local"``
            is the local facet size at each contact detection.
        constraints: Whether the law is evaluated at ``"nodes"``, or at contact quadrature
            ``"points"``.
        augmented: Whether the multiplier is augmented until the gap is closed.
        gap_tolerance: Largest gap after augmentation, in units of the smallest facet.
        sliding: ``"small"`` or ``"finite"``; with the latter, the geometry of contact is updated.
        sharp: Whether vertices at sharp edges of the slave, and of the master, have their own
            contact pairs; see :func:`pair_vertices`.
        sharp_nodes: Sharp vertices of the slave, and of the master, when the contact was created;
            None for a rigid tool. What is sharp must not depend on when contact is detected.
        name: Name in messages; None for the contact's number among those of its problem.
        reach: Opening (length) beyond which a user's law gives no multiplier; None if unknown.
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
    sharp_nodes: tuple[SharpNodes | None, SharpNodes | None] = (None, None)
    name: str | None = None
    reach: float | None = None

    @property
    def type(self) -> ContactType:
        """What the constraints measure."""
        if self.slave.is_scalar:
            return ContactType.FIELD
        if self.law.jump:
            return ContactType.TIE
        return ContactType.NORMAL if self.slave.key is None else ContactType.ITSELF

    @property
    def rows(self) -> str:
        """Kind of the constraints of the gaps, see :class:`WeightedGap`."""
        if self.constraints == "points":
            return "points"
        return "cover" if self.sampling.quadrature == "overlay" else "area"

    @property
    def bodies(self) -> tuple[Surface, ...]:
        """Surfaces of bodies: the slave, and the master unless it is a rigid tool."""
        return self.slave, *self.master.bodies

    @property
    def facet_size(self) -> float:
        """Size of the smallest facet (length)."""
        with_facets = [s for s in (self.slave, self.master) if not s.is_analytic]
        return min(s.facet_size_range[0] for s in with_facets)

    @property
    def largest_facet(self) -> float:
        """Size of the largest facet of the bodies (length). Collective.

        Facets of rigid tools do not count: on flat parts they may be very large.
        """
        return max(surface.facet_size_range[1] for surface in self.bodies)

    @property
    def roles(self) -> list[tuple[Surface, AnySurface]]:
        """Slave and master of each integration side."""
        roles: list[tuple[Surface, AnySurface]] = [(self.slave, self.master)]
        if self.formulation == "double-pass":
            roles += [(body, self.slave) for body in self.master.bodies]
        return roles

    @property
    def roles_of_vertices(self) -> list[VerticesRole]:
        """Roles of slave and master for the constraints of vertices at sharp edges."""
        out = [VerticesRole(self.slave, self.master, of_tool=False)] if self.sharp[0] else []
        if self.sharp[1]:
            out += [VerticesRole(body, self.slave, of_tool=False) for body in self.master.bodies]
        if self.sharp[1] and (self.sliding == "small" or self.slave.gdim == 2):
            out += [VerticesRole(self.slave, tool, of_tool=True) for tool in self.master.tools]
        return out

    @property
    def roles_of_edges(self) -> list[EdgesRole]:
        """Roles of slave and master for the constraints of sharp edges in 3D."""
        if self.master.is_analytic or self.slave.gdim == 2 or self.sliding == "finite":
            return []
        slave, master = self.slave, self.master
        roles = [EdgesRole(slave, master, (True, True))] if all(self.sharp) else []
        if self.sharp[0]:
            roles += [EdgesRole(body, slave, (False, True)) for body in master.bodies]
            roles += [EdgesRole(slave, tool, (True, False)) for tool in master.tools]
        if self.sharp[1]:
            roles.append(EdgesRole(slave, master, (False, True)))
        return roles


class ChordGaps(typing.NamedTuple):
    """Changes of gaps by the chord errors of facets.

    Attributes:
        of_nodes: At the slave's owned nodes (length).
        spread: Standard deviation at points, which vary within facets (length).
    """

    of_nodes: npt.NDArray[np.float64]
    spread: float


@dataclasses.dataclass(frozen=True)
class Paired:
    """Result of one contact detection; only the states of its parts change.

    Attributes:
        gaps: Weighted gaps of the integration sides, then those of vertices and of sharp edges.
        slips: Slip of each gap; none without friction.
        radius: Search distance (length), beyond which points were not paired.
        facet_size: Size of the smallest facet (length).
        tool_version: Version number of a rigid tool's position at contact detection.
    """

    gaps: tuple[WeightedGap, ...]
    slips: tuple[Slip, ...]
    radius: _cpp.SearchRadius
    facet_size: float
    tool_version: int

    @property
    def touching(self) -> float:
        """Gap (length) that counts as closed."""
        return ROUNDING * self.facet_size

    @property
    def search_radius(self) -> float:
        """Distance (length) beyond which nothing was paired anywhere."""
        return self.radius.largest

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts with multipliers: the gaps, then their slips."""
        return (*self.gaps, *self.slips)


@dataclasses.dataclass(frozen=True)
class HeldNodes:
    """Nodes of an integration side whose gap is prescribed by conditions.

    Attributes:
        gap: The integration side.
        at_nodes: The gaps of the nodes themselves, not weighted with those around.
        components: Constrained components, of the shape of these gaps.
    """

    gap: WeightedGap
    at_nodes: WeightedGap
    components: npt.NDArray[np.bool_]


@dataclasses.dataclass
class HeldSlip:
    """Components of the nodes of a slip that conditions constrain on both sides.

    Attributes:
        slip: The slip.
        by_node: Its integration side with one constraint for each node.
        held: The components, shape (rows, block).
        clamped: Those components that belong to fully constrained nodes, of the same shape.
        at_nodes: The gaps of the vertices themselves, not weighted with those around.
        of_master: Nonzero at the unknowns of the master's body that have conditions; None for a
            rigid tool.
        redundant: Components of ``held`` that are condensed at present; None before this is known.
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
    """Positions of penetrating slave nodes at the first contact detection.

    Attributes:
        nodes: Flags of these nodes among all nodes of this rank, shape (nodes,).
        x: Their positions in the frame of the master, shape (such nodes, 3).
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
    """Detect contact between the surfaces at their present positions. Collective.

    Args:
        settings: Settings of the contact.
        friction: None without.
        known: Contact quadrature points of the only integration side; None if they are to be found.
    """
    master = settings.master
    check_curved(settings.bodies, settings.sampling.quadrature, not master.is_analytic)
    radius = radius_of(settings)
    roles = settings.roles
    both = settings.formulation == "quasi-symmetric"
    corners = not settings.law.jump  # a single pair ties a node in all directions
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
            turns=settings.sliding,
            of=settings.name,
        )
        for (first, second), found in zip(roles, points, strict=True)
    )
    gaps += _at_creases(settings, radius)
    slips = () if friction is None else friction.slips_of(gaps)
    return Paired(gaps, slips, radius, settings.facet_size, master.version)


def _at_creases(settings: Settings, radius: _cpp.SearchRadius) -> tuple[WeightedGap, ...]:
    """Gaps of vertices at sharp edges, then of sharp edges. Collective."""
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
            of=settings.name,
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
    """Updated geometry of the gaps of an integration side; None for linear gaps. Collective.

    Args:
        settings: Of the contact.
        slave: Slave of the integration side.
        master: Master of the integration side.
        radius: Search distance, beyond which points are not paired.
        vertices_of: Body whose vertices are the points: ``"slave"`` or ``"tool"``; None for points
            on facets.
    """
    if not follows(settings.sliding, settings.law):
        return None
    degree = settings.sampling.degree
    sharp = settings.sharp_nodes
    if slave is not settings.slave:
        sharp = sharp[::-1]
    cutter: Cutter
    if is_shape(master):
        cutter = ShapePoints(slave, master, radius.largest, None if vertices_of else degree)
    elif vertices_of == "tool":
        cutter = FacetCutter(slave, master, ToolVertices(slave, master, radius, sharp[0]))
    elif vertices_of == "slave":
        cutter = FacetCutter(slave, master, Vertices(slave, master, radius, sharp))
    else:
        # Points of the slave's facets sample all of a tool's shape.
        both = settings.formulation == "quasi-symmetric" and not is_rigid(master)
        cutter = FacetCutter(slave, master, Overlay(slave, both, radius, degree))
    return Following(slave, master, radius.largest, cutter)


def radius_of(settings: Settings) -> _cpp.SearchRadius:
    """Search distance of contact detection. Collective.

    The default is the size of the largest facet, since bodies that are pressed together approach
    each other in the whole region of later contact. With finite sliding the distance is larger, so
    that Newton iterates do not lose their contact pairs; and with a law that acts at a distance,
    so that surfaces that it holds are not lost.
    """
    if isinstance(settings.search_radius, float):
        return _cpp.SearchRadius(settings.search_radius)
    largest = settings.largest_facet
    if settings.sliding == "finite":
        largest *= FOLLOWING_REACH
    if settings.search_radius is None and settings.reach is not None:
        largest = max(largest, BEYOND_REACH * settings.reach)
    local = settings.search_radius == "local" and not settings.master.is_analytic
    return _cpp.SearchRadius(largest, by_size=local)


class Mechanics(typing.Protocol):
    """Data of the bodies' contact for a scalar field: see ``contact.across``.

    Attributes:
        of: The bodies' contact.
        shares_pairs: Whether the field uses the bodies' contact pairs.
        at_points: The bodies' gaps at their contact quadrature points, if the field uses these.
    """

    of: ContactModel
    shares_pairs: bool
    at_points: PointRows

    @property
    def is_stale(self) -> bool:
        """Whether the bodies' contact pairs have been updated since :meth:`points`."""

    def points(self) -> _cpp.PairingPoints:
        """The bodies' contact quadrature points with the unknowns of the field. Collective."""

    def pressure(self) -> npt.NDArray[np.float64]:
        """Pressure at the points, or at the slave's nodes. Collective."""

    def distance(self) -> npt.NDArray[np.float64]:
        """Distance at the points. Collective."""

    def dissipation(self) -> npt.NDArray[np.float64]:
        """Energy dissipated by friction at the slave's nodes. Collective."""

    def rows_at_points(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Values of the bodies' constraints at the vertices of points' facets. Collective."""


class Coupling(typing.Protocol):
    """Tangent terms of variable conductances: see ``contact.coupling``."""

    @property
    def of_bodies(self) -> ContactModel | None:
        """The bodies' contact if its multipliers are unknowns together with those of the field."""

    def add_to(self, blocks: BlocksOf, pattern: bool) -> None:
        """Add to the blocks ss, sm, ms, mm. Collective."""

    def by_multipliers(self) -> list[PETSc.Mat]:
        """Derivatives of each side's flow by the bodies' multipliers λ̂. Collective."""

    def destroy(self) -> None:
        """Free the matrices. Collective."""


class Physics(typing.Protocol):
    """Functions in which contacts of bodies and of scalar fields differ.

    They are those of the modules ``contact.bodies`` and ``contact.conduction``.
    """

    def begin(self, model: ContactModel, paired: Paired) -> None:
        """Prepare new contact pairs, before the contact has them. Collective."""

    def look(self, model: ContactModel) -> None:
        """Check and use data that may have changed, before gaps are evaluated. Collective."""

    def evaluate(self, model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Compute what depends on the gaps, after they have been evaluated. Collective."""


class ContactModel:
    """State and settings of a contact, from which its terms are evaluated.

    Args:
        settings: Constant settings of the contact.
        physics: Functions for its type of unknowns.
        kinematics: How unknowns move its surfaces.
        penalty: Penalty parameter ε.
        overclosure: Treatment of initial penetration.
        friction: None without.
        mechanics: Contact of the bodies, for a scalar field; None if it is not needed.
    """

    def __init__(
        self,
        settings: Settings,
        physics: Physics,
        kinematics: Kinematics,
        penalty: Penalty,
        overclosure: Overclosure,
        friction: FrictionHistory | None,
        mechanics: Mechanics | None = None,
    ) -> None:
        self.settings = settings
        self.physics = physics
        self.kinematics = kinematics
        self.penalty = penalty
        self.overclosure = overclosure
        self.friction = friction
        self.mechanics = mechanics
        #: Kinds of warnings already given for it, see :mod:`qsdolfinx.contact.findings`.
        self.told: set[str] = set()
        #: Frictional heat of the bodies, as a load for temperatures; None without friction.
        self.friction_heat: FrictionHeat | None = None
        #: ``num_pairings`` at the last evaluation.
        self.evaluated_at = 0
        #: Whether gaps have been evaluated: before that there are no forces.
        self.is_evaluated = False
        #: State of the last evaluation if parts have been replaced since: see ``contact.shown``.
        self.kept: ContactModel | None = None
        #: Minus the smallest, and the largest value of a scalar field at the slave's constraints on
        #: this rank.
        self.field_range: npt.NDArray[np.float64] = np.zeros(2)
        #: Arguments of the conductances at the last evaluation, at the points.
        self.conduction_state: tuple[npt.NDArray[np.float64], ...] = ()
        #: Whether the contact in mechanics is between the same bodies, which have mixed unknowns.
        self.with_bodies = False
        #: Tangent terms of variable conductances; None if there are none.
        self.coupling: Coupling | None = None
        #: Whether the problem chooses ``sliding``, see :mod:`qsdolfinx.contact.chosen_sliding`.
        self.sliding_is_open = False
        #: Whether the user has set ``sliding``.
        self.sliding_is_given = False
        #: Result of the last contact detection; see :func:`qsdolfinx.contact.motion.pair_anew`.
        self.paired: Paired
        #: Positions of the surfaces at the last evaluation.
        self.placement: Placement
        #: Motion of a rigid tool since contact detection, as used by the gaps; None for none.
        self.tool_motion: Affine | None = None
        #: Distances that :mod:`qsdolfinx.contact.depth` has measured for a placement.
        self.measured: object | None = None
        #: Number of contact detections so far.
        self.num_pairings = 0
        #: Displacements (length) added to those of the unknowns, for the slave's and the master's
        #: body; see :meth:`qs.Contact.set_offset`.
        self.offset: tuple[PETSc.Vec | None, PETSc.Vec | None] | None = None
        #: Updates the contact pairs at the positions after a time step; None if this is not
        #: pending.
        self.catch_up: typing.Callable[[], None] | None = None
        #: Initial positions of penetrating slave nodes, as long as sliding of them is checked.
        self.overclosed_from: OverclosedStart | None = None
        #: Whether signs and slopes of its law have been checked.
        self.is_law_checked = False
        #: Returns the problem that the contact is part of, or None once the problem is gone; None
        #: before it is part of a problem.
        self.problem: typing.Callable[[], object] | None = None
        #: Errors of the gaps at the slave's nodes due to chord errors (length); None before any
        #: solve.
        self.chord_gaps: ChordGaps | None = None
        #: Nodes whose gap is prescribed by conditions; see :func:`qsdolfinx.contact.held.find`.
        self.held_nodes: list[HeldNodes] = []
        #: Slip components constrained by conditions; see
        #: :func:`qsdolfinx.contact.held.begin_solve`.
        self.held_slips: list[HeldSlip] = []
        #: Whether conditions constrain the slave, and the master, where the opposite side is free.
        self.held_alone = (False, False)
        #: Wall time of this rank in contact detection, gaps and insertion.
        self.watch = Stopwatch()

    @property
    def name(self) -> str | None:
        """Name in messages; None for its number among the problem's contacts."""
        return self.settings.name

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.settings.slave

    @property
    def master(self) -> AnySurface:
        """The other surface, or a rigid tool."""
        return self.settings.master

    @property
    def bodies(self) -> tuple[Surface, ...]:
        """Surfaces of bodies: the slave, and the master unless it is a rigid tool."""
        return self.settings.bodies

    @property
    def is_scalar(self) -> bool:
        """Whether the unknowns are scalar fields, such as temperatures, which cause no motion."""
        return self.type is ContactType.FIELD

    @property
    def with_itself(self) -> bool:
        """Whether slave and master are the same boundary (self-contact)."""
        return self.type is ContactType.ITSELF

    @property
    def type(self) -> ContactType:
        """What the constraints measure."""
        return self.settings.type

    @property
    def has_gaps(self) -> bool:
        """Whether the constraints are normal gaps, and not those of a tie or a scalar field."""
        return self.type in ContactType.GAPS

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.slave.comm

    @property
    def law(self) -> Law:
        """Contact law: multiplier as a function of the gap."""
        return self.settings.law

    @property
    def augmented(self) -> bool:
        """Whether the multiplier is augmented until the gap is closed."""
        return self.settings.augmented

    @property
    def gaps(self) -> tuple[WeightedGap, ...]:
        """Weighted gaps of the integration sides, then those of vertices and of sharp edges."""
        return self.paired.gaps

    @property
    def of_sides(self) -> tuple[WeightedGap, ...]:
        """Weighted gaps of the sides with multipliers."""
        return self.paired.gaps[: len(self.settings.roles)]

    @property
    def pairings(self) -> list[Pairing]:
        """Contact pairs of each integration side: two for double-pass contact, otherwise one."""
        return [Pairing.from_cpp(gap.points) for gap in self.of_sides]

    @property
    def of_vertices(self) -> tuple[WeightedGap, ...]:
        """Weighted gaps of vertices at sharp edges, and of sharp edges."""
        return self.paired.gaps[len(self.settings.roles) :]

    @property
    def slips_of_vertices(self) -> tuple[Slip, ...]:
        """Slips of :attr:`of_vertices`; none without friction."""
        return self.slips[len(self.settings.roles) :]

    @property
    def slips(self) -> tuple[Slip, ...]:
        """Slip of each gap; none without friction."""
        return self.paired.slips

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts with multipliers: the gaps, then their slips."""
        return self.paired.parts

    def take_parts(self, gaps: tuple[WeightedGap, ...], slips: tuple[Slip, ...]) -> None:
        """Replace gaps and slips by others of the same contact detection."""
        self.paired = dataclasses.replace(self.paired, gaps=gaps, slips=slips)

    @property
    def eps(self) -> float:
        """ε, or γ of multipliers at points, as a number (stress per length).

        γ is always the automatic penalty, also if a penalty is given: it is the stiffness of those
        gaps within a facet that multipliers cannot represent. With a penalty softer than γ there
        are no multipliers at points.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        given, usual = self.penalty.eps, self.penalty.of_points
        return usual if self.has_multipliers_at_points and usual is not None else given

    @property
    def has_multipliers_at_points(self) -> bool:
        """Whether constraints at points have multipliers: not if penalties are as soft as bodies.

        Double-pass contact with finite sliding has none either: two fields of multipliers for the
        same gaps, at other points in each iteration, are not determined.
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
        """Part of multipliers acting at points: 1, or less if a penalty is their compliance."""
        exact = self.augmented or not self.has_multipliers_at_points
        return 1.0 if exact else 1 - self.eps / self.penalty.eps

    @property
    def stiffness_ratio(self) -> float:
        """Penalty over stiffness of the softer side; 0 if either is not known."""
        ratio = self.penalty.ratio
        return ratio * self.eps / self.penalty.eps if ratio > 0 else 0.0

    @property
    def tangential_eps(self) -> float:
        """Penalty ε in tangential direction; only with friction."""
        assert self.friction is not None
        return self.friction.penalty(self.eps if self.augmented else self.penalty.eps)

    @property
    def slip_penalty(self) -> tuple[float, float]:
        """Stiffness of slips at points: γ_t (stress per length), and γ_t/ε_t for a penalty.

        γ_t is ε_t, but not above its automatic value. With a larger γ_t, the direction of slip
        would change in each iteration, and γ_t matters only for the differences between points and
        their nodes. The second number is 0 for an augmented Lagrangian.
        """
        eps, usual = self.tangential_eps, self.penalty.of_slips
        gamma = eps if usual is None else min(eps, usual)
        return gamma, 0.0 if self.augmented else gamma / eps

    @property
    def compliance(self) -> float:
        """Gap closed by a pressure at a node, over this pressure: from penalty and bodies."""
        of_bodies = sum(1 / k for k in self.penalty.stiffness if k > 0)
        return of_bodies + (0.0 if self.augmented else 1 / self.penalty.eps)

    @property
    def allowed_gap(self) -> float:
        """Largest gap (length) that multipliers may leave."""
        return self.settings.gap_tolerance * self.paired.facet_size

    @property
    def follows(self) -> bool:
        """Whether gaps use updated geometry: they are computed anew at each evaluation."""
        return any(gap.following is not None for gap in self.gaps)

    @property
    def is_linear(self) -> bool:
        """Whether gaps are linear functions of the unknowns."""
        return all(gap.is_linear for gap in self.gaps)

    @property
    def symmetric(self) -> bool:
        """Whether the contribution of contact to the tangent is symmetric."""
        if self.coupling is not None or self.follows:  # shape functions at points move
            return False
        first, second = self.kinematics.scale
        equal = first == second
        law = None if self.friction is None else self.friction.law
        if law is None or not equal:
            return equal
        # At points, a discontinuous friction limit goes with the pressure where this is almost
        # zero.
        goes = law.jumps and any(slip.gap.rows.are_points for slip in self.slips)
        return law.symmetric and not goes

    def called(self, number: int) -> str:
        """Text for messages: its name, or its number among the problem's contacts."""
        return f"contact {number if self.name is None else repr(self.name)}"

    def ordered(self, gap: WeightedGap, of_bodies: tuple[T, T]) -> tuple[T, T]:
        """Sort values of the slave's and master's body by the roles of an integration side."""
        return of_bodies if gap.slave is self.slave else (of_bodies[1], of_bodies[0])
