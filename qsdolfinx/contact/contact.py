"""Contact between two surfaces: formulation, law, penalty, and what there is to read afterwards."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import POSITIVE, check, either, instance, one_of
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import fields, motion, multipliers, overclosed, results
from qsdolfinx.contact.across import BodiesContact, check_of, shares_pairs
from qsdolfinx.contact.advice import advise, chord_errors, smoothed, tell_smoothed
from qsdolfinx.contact.arguments import (
    SLAVE,
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
    check_smoothing,
    check_surfaces,
    default_constraints,
    default_enforcement,
)
from qsdolfinx.contact.model import ContactModel, Settings
from qsdolfinx.contact.penalty import Penalty, points_factor
from qsdolfinx.contact.report import ContactReport, make_report
from qsdolfinx.contact.shown import keep, shown
from qsdolfinx.friction.history import FrictionHistory
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.kinematics import Kinematics, unknowns_of
from qsdolfinx.gap.laws import Conductance, Law, Tied, Unilateral
from qsdolfinx.gap.overclosure import Overclosure
from qsdolfinx.gap.rows import CONSTRAINTS
from qsdolfinx.pairing.facets import has_creases
from qsdolfinx.pairing.pair import NORMALS, QUADRATURES, Sampling, check_quadrature
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.pairing.relief import Side, Smoothing, sides_of
from qsdolfinx.surface.itself import boundary_of
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

Array = npt.NDArray[np.float64]

SLIDING = ("small", "finite")
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")


class Contact:
    """Contact of a slave surface with a master surface.

    Given no more than the two, it is quasi-symmetric contact with exact integrals, in which an
    augmented Lagrangian closes the gaps. The paper's own method is ``quadrature="nodal"`` with
    ``enforcement="penalty"``.

    The energy of a penalty is Φ = ½ ε Σ_k S_k [ḡ_k]₊² over the slave nodes k. The formulations
    differ in where the gap is sampled: ``"master-slave"``, (5), at the slave's side;
    ``"quasi-symmetric"``, (11) and (12), at both sides, while the multiplier stays on the slave;
    ``"double-pass"``, (6), is the mean of two master-slave contacts with the roles swapped, and so
    has multipliers on both sides. They cannot close every gap of non-matching meshes: it takes a
    moderate penalty, and no augmented Lagrangian.

    The ½ of (11) is kept in the gap, so that ε means the same in every formulation: matching meshes
    give the same result with each. The ρ of (12) is ε/8 for quasi-symmetric contact and ε/2 for
    master-slave.

    Pairing points are found when the object is made, and again by :meth:`update`. Collective.

    What is read, such as :meth:`force`, :meth:`pressure` and :meth:`gap`, is that of the last solve
    (or of the last step of a ``qs.TimeStepper``) until the next one, whatever is changed since:
    unknowns, tools, meshes, pairs by :meth:`update`, penalty, multipliers by :meth:`reset`; also
    after a solve that fails. Before the first solve forces, tractions, multipliers and energies are
    zero, and gaps those of the surfaces as they were paired. Of the present pairs are
    :attr:`pairing`, :attr:`num_unpaired` and :attr:`search_radius`.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool; or the same surface, parts of which may come to
            touch each other: it then stands for all facets that are the master of another one,
            and ``slave`` and ``master`` are surfaces of their own, of all of the body's boundary.
        formulation: ``"master-slave"``, ``"double-pass"`` or ``"quasi-symmetric"``. A rigid tool
            carries no multiplier, so that only the first and the third are possible; with an
            analytic shape they are the same.
        law: ``Unilateral()``, ``Tied()`` or a :class:`qs.Law` of your own; of scalar fields
            ``Tied()`` or ``Conductance(h)``.
        penalty: ε, stress per length; ``"auto"`` takes it from the stiffness of the bodies at the
            contact nodes when the problem is first solved; with an augmented Lagrangian and bodies
            in velocities, whenever contact has paired anew.
        search_radius: Points further than this from the other surface are not paired (length). By
            default the largest facet of the two surfaces, of a rigid tool's that of the slave.
            ``"local"``: place by place the size of the larger of the two facets, for surfaces whose
            fine parts are to look no further than they have to.
        quadrature: ``"overlay"``: (7) is integrated exactly over the pieces that the facets of one
            surface cut from those of the other. ``"nodal"``, the paper's: the gap is sampled at
            nodes, as in (5), (6), (12), for displacements of degree 1. It is cheaper, and tractions
            on non-matching meshes are wrong by a share that does not fall with the size of facets.
        quadrature_degree: Degree of the rule on the pieces of the overlay; by default that of the
            integrand on affine facets, and with ``sliding="finite"`` between quadrilaterals 2, or
            4 with displacements of degree 2.
        normals: Along which the gap is measured: ``"facet"``, of the facet that is found or cut
            (the default at nodes without friction); ``"bisector"`` of it and the mean normal at the
            node or point of the other surface (the default on the overlay, and with friction,
            which takes closing a gap along a tilted facet's normal for slip). Bisectors are for two
            deformable bodies: of a rigid tool, of facets or analytic, the normals are always its
            own, at the point that is closest or opposite; if it is smoothed, those of its surface.
        enforcement: ``"augmented-lagrangian"``, the default where there is one: multipliers are
            updated until they leave no gap larger than the tolerance, with any penalty. (With
            direct solvers a penalty that takes too many updates is raised.) They are
            kept for the next solve, also when contact pairs anew; :meth:`reset` forgets them.
            ``"penalty"``, the default of double-pass contact: a gap of λ/ε is left.
        gap_tolerance: That gap in units of the smallest facet, or less: where it is more than 1e-4
            of λ/ε, as under small loads, that is the limit; and where a body with held nodes is
            tied to a much stiffer one, what stands for 1e-5 of the largest λ in that.
        unknown: What the unknowns of the bodies are: ``"displacement"`` or ``"velocity"``, (2) and
            (3), or one of them for the slave and the master, such as a forged workpiece and an
            elastic die, ``("velocity", "displacement")``.
        dt: Δt, time, if a body has velocities or friction depends on rates, or for the heat of
            friction if the contact in ``of`` has none; :meth:`set_dt` changes it.
        friction: ``qs.Coulomb``, ``qs.Tresca``, ``qs.CoulombTresca``, ``qs.Norton``,
            ``qs.Sticking``, or None. Slip counts from the end of the last step: a step is a solve
            of the problem, unless the solve is part of ``ContactProblem.one_step``.
        friction_penalty: ε in tangential direction (stress per length); by default that of the
            gaps. Not used by ``qs.Norton``.
        initial_overclosure: What becomes of penetration at the first pairing, before anything has
            moved. ``"resolve"``: it is a misfit as any other, and the next solve presses the bodies
            apart (an interference fit; :meth:`allow_overclosure` does so gradually). ``"ignore"``:
            it never counts as a gap: each node keeps its depth, without strain, wherever it slides,
            and nodes that the other surface slides to get the same if all are as deep. With finite
            sliding at points that is the mean of the points around it, and as much more as it takes
            for none of them to press. ``"error"``: it is refused. Points deeper than the search
            radius are not paired, and not seen. A tie leaves any gap as it is; with it the first
            two are the same.
        constraints: Where the law is asked for a multiplier. ``"points"``: at each contact
            quadrature point, that of friction too, so that what is open takes nothing from what is
            closed beside it, and at vertices and edges of creases, which are ahead of their facets;
            multipliers are functions on the slave's nodes. ``"nodes"``: at the slave nodes, for
            weighted gaps, with small sliding. By default ``"points"`` of unilateral contact on the
            overlay, and of all that follows the bodies; ties, double-pass contact, nodal
            quadrature, and a law of the user's with a penalty have ``"nodes"``.
        smoothing: What the gap is measured between, one for both sides or a pair for slave and
            master, on the overlay. ``"auto"``: the facets, or with small sliding, where both sides
            are curved alike and chords change the gap by more than a tenth of the clearance or
            interference, as ``"shared-curvature"``, with a warning that says so. ``"none"`` or
            None: the facets; those of a mesh of degree 2 as they are curved.
            ``"shared-curvature"``: the curved surfaces that the facets approximate, as far as both
            sides share their curvature, which is found from how neighbouring facets turn. Creases
            of more than 30° stay. A surface by name, such as ``qs.smooth.Cylinder``: the one that
            the side's vertices are on when the contact is made; it goes along with the facets. On
            conforming surfaces of non-matching meshes, such as shrink fits and journal bearings, or
            of a slave on an analytic tool, which itself has nothing to smooth, chord errors are not
            part of the gap then. A tie leaves any gap as it is.

        sliding: ``"small"``: pairs, normals and areas stay as they were paired while a solve lasts.
            ``"finite"``: the geometry of contact follows the bodies within the solve, however far
            they slide or turn; facets are cut anew at each iteration. It needs the overlay, with
            normals of the facets. Areas are those at the start of the solve. By default small, and
            finite as soon as it is part of a problem where the form of one of its bodies is
            nonlinear, or of a :class:`qs.TimeStepper`: but for bodies in velocities, tools that a
            moment drives, the nodal rule, ``constraints="nodes"``, ``smoothing``, contacts that
            have been solved for already, and, in 3D, creases that are near edges of the other side,
            ahead of their facets.
        of: Of scalar fields, the contact of the bodies that they are fields of, on the same facets:
            the field has its pairs, so that nothing is searched twice, and a conductance its
            pressures, distances and friction. Where its master is a rigid tool that has a mesh of
            its own for the field, fields are paired by themselves, where meshes are.

    Surfaces on scalar spaces, such as of temperatures, have no gaps: ``qs.Tied()``, the default,
    makes the field continuous, and ``qs.Conductance(h)`` lets a flux h ⟦T⟧ through. Then λ, of the
    sign of ⟦T⟧ = T_s − T_m, is what flows from the slave to the master per area; see :meth:`flux`
    and :meth:`flow`. What is said of displacements and forces above is not used.

    Raises:
        ValueError: If a name is unknown, the penalty or the radius is not positive, the two
            surfaces share facets or differ in dimension or communicator, or vertices are not on the
            surface that is named for them.
        TypeError: If a surface or the law is of another type.

    Warns:
        ContactWarning: If hardly anything is paired, the master is much finer and sampled at nodes
            (the first solve warns of a finer slave, too, with a soft penalty), a tool's facets look
            turned, the surfaces penetrate each other deeply, or the chord error of facets on
            conforming surfaces is not small beside their clearance or interference.

    Attributes:
        model: The parts, for the problem and for those who extend the library.
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface | RigidSurface,
        formulation: str = "quasi-symmetric",
        law: Law | None = None,
        penalty: float | str = "auto",
        search_radius: float | str | None = None,
        quadrature: str = "overlay",
        quadrature_degree: int | None = None,
        normals: str | None = None,
        enforcement: str | None = None,
        gap_tolerance: float = 1e-8,
        unknown: str | typing.Sequence[str] = "displacement",
        dt: float | None = None,
        friction: Friction | None = None,
        friction_penalty: float | None = None,
        initial_overclosure: str = "resolve",
        constraints: str | None = None,
        smoothing: Side | tuple[Side, Side] = "auto",
        sliding: str | None = None,
        of: Contact | None = None,
    ) -> None:
        self.model: ContactModel
        check(SLAVE, slave=slave)
        if law is None:
            law = Tied() if slave.is_scalar else Unilateral()
        rigid = as_tool(master) is not None
        itself = master is slave
        with checked(slave.comm) as same:
            check_surfaces(slave, master)
            same(slave="scalar" if slave.is_scalar else "vector")
            same(master="the slave" if itself else type(master).__name__)
            same(one_of(FORMULATIONS), formulation=formulation)
            if enforcement is None:
                enforcement = default_enforcement(formulation, law)
            same(one_of(ENFORCEMENTS), enforcement=enforcement)
            check_formulation(formulation, enforcement, master)
            same(one_of(QUADRATURES), quadrature=quadrature)
            check(instance(Law, "qs.Tied() or qs.Unilateral()"), law=law)
            follows = sliding == "finite" and not law.jump
            degree = check_quadrature(slave, master, quadrature, quadrature_degree, follows)
            check_friction(friction, slave)
            # Before what follows from them: of several arguments that differ the first is named.
            same(law=type(law).__name__, friction=friction, of=None if of is None else "contact")
            given = Given(
                formulation, quadrature, unknown, sliding, initial_overclosure, constraints
            )
            check_field(slave, master, law, enforcement, friction, penalty, given)
            how = {"search_radius": search_radius, "normals": normals}
            shares = isinstance(of, Contact) and shares_pairs(of.model, master)
            check_of_use(slave, law, of, given, shares, quadrature_degree=quadrature_degree, **how)
            if isinstance(law, Conductance):
                same(**law.numbers)
            same(unknown=unknowns_of(unknown, rigid))
            same(either(one_of(SLIDING), None), sliding=sliding)
            is_open = sliding is None and normals is None and quadrature == "overlay"
            is_open &= not slave.is_scalar and constraints != "nodes"
            is_given, sliding = sliding is not None, sliding or "small"
            if normals is None and sliding == "finite":
                normals = "facet"
            if normals is None:
                averaging = quadrature == "overlay" or friction is not None
                normals = "bisector" if averaging else "facet"
            same(one_of(NORMALS), normals=normals)
            automatic = isinstance(smoothing, str) and smoothing == "auto"
            sides = sides_of("none" if automatic else smoothing, master)
            same(smoothing=(automatic, sides))
            check_smoothing(sides, quadrature)
            same(either(POSITIVE, "auto"), penalty=penalty)
            same(either(either(POSITIVE, "local"), None), search_radius=search_radius)
            same(POSITIVE, gap_tolerance=gap_tolerance)
            same(either(POSITIVE, None), friction_penalty=friction_penalty)
            same(either(one_of(CONSTRAINTS), None), constraints=constraints)
            if constraints is None:
                constraints = default_constraints(
                    quadrature, formulation, law, enforcement, sliding
                )
            check_memory(law, enforcement, constraints, sliding)
            check_sliding(sliding, quadrature, normals, constraints, sides, law)
            if itself:
                check_itself(formulation, quadrature, law, sides, unknown)
            if of is not None:
                check_of(of.model, slave, master)
                if shares:
                    formulation = of.formulation
            overclosure = Overclosure(initial_overclosure)
            same(quadrature_degree=degree, dt=dt, initial_overclosure=initial_overclosure)
        # All ranks have been given the same: these need not be agreed upon.
        check_friction_use(friction, friction_penalty, law)
        check_constraints(constraints, quadrature, law)
        if isinstance(law, Conductance):
            penalty, constraints = 1.0, "points"  # h takes its place, at each point
        needs_dt = friction is not None and friction.needs_dt
        if isinstance(law, Conductance) and law.friction is not None:
            needs_dt = of is None or of.dt is None or dt is not None
        kinematics = Kinematics(unknown, dt, needs_dt, rigid_master=rigid)
        augmented = enforcement == "augmented-lagrangian"
        if itself:
            slave, master = boundary_of(slave), boundary_of(slave)
        at_points = constraints == "points" and not (itself or isinstance(law, Conductance))
        sharp = has_creases(slave, at_points), has_creases(master, at_points)
        settings = Settings(
            slave,
            master,
            formulation,
            law,
            Sampling(
                quadrature,
                degree,
                normals,
                Smoothing(slave, master, sides, follows),
                quadrature_degree is not None,
            ),
            search_radius
            if search_radius is None or isinstance(search_radius, str)
            else float(search_radius),
            constraints,
            augmented,
            float(gap_tolerance),
            sliding,
            sharp,
        )
        alike = None
        if automatic:
            may_be = (quadrature, sliding) == ("overlay", "small") and not (
                itself or slave.is_scalar
            )
            alike = chord_errors(settings) if may_be else None
            smoothing = "none"
        if alike is not None:
            settings, smoothing = smoothed(settings), "shared-curvature"
        self._smoothing = smoothing
        is_open &= sides == (None, None) and alike is None
        is_open &= law.jump or constraints == "points"
        self.model = ContactModel(
            settings,
            kinematics,
            Penalty(
                penalty,
                quadrature,
                augmented,
                "velocity" in kinematics.unknown,
                points_factor(constraints, follows),
            ),
            overclosure,
            None if friction is None else FrictionHistory(friction, slave, friction_penalty),
            None if of is None else BodiesContact(of.model, slave, master),
        )
        self.model.sliding_is_open, self.model.sliding_is_given = is_open, is_given
        motion.pair_anew(self.model)
        advise(self.model)
        if alike is not None:
            tell_smoothed(self.model, alike)

    # --- What it was made with

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.model.slave

    @property
    def master(self) -> AnySurface:
        """The other surface, or a rigid tool."""
        return self.model.master

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.model.comm

    @property
    def formulation(self) -> str:
        """Which surfaces are sampled, and which carry multipliers."""
        return self.model.settings.formulation

    @property
    def law(self) -> Law:
        """From the gap to the multiplier."""
        return self.model.law

    @property
    def quadrature(self) -> str:
        """``"nodal"`` or ``"overlay"``."""
        return self.model.settings.sampling.quadrature

    @property
    def quadrature_degree(self) -> int:
        """Degree of the rule on the pieces of the overlay."""
        return self.model.settings.sampling.degree

    @property
    def constraints(self) -> str:
        """Where the law is asked for a multiplier, at ``"nodes"`` or ``"points"``."""
        return self.model.settings.constraints

    @property
    def normals(self) -> str:
        """``"facet"`` or ``"bisector"``."""
        return self.model.settings.sampling.normals

    @property
    def sliding(self) -> str:
        """``"small"``, or ``"finite"``: contact's geometry follows the bodies.

        If it was left open, a problem with nonlinear bodies, or a time stepper, makes it finite.
        """
        return self.model.settings.sliding

    @property
    def smoothing(self) -> Side | tuple[Side, Side]:
        """What the gap is measured between, as given."""
        return self._smoothing

    @property
    def enforcement(self) -> str:
        """``"penalty"`` or ``"augmented-lagrangian"``."""
        return "augmented-lagrangian" if self.augmented else "penalty"

    @property
    def augmented(self) -> bool:
        """Whether the multiplier is augmented until the gap is closed."""
        return self.model.augmented

    @property
    def gap_tolerance(self) -> float:
        """Gap at which augmentation ends, in units of the smallest facet."""
        return self.model.settings.gap_tolerance

    @property
    def allowed_gap(self) -> float:
        """``gap_tolerance`` × the smallest facet: the largest gap that augmentation leaves."""
        return self.model.allowed_gap

    @property
    def friction(self) -> Friction | None:
        """The law of friction, None without."""
        return None if self.model.friction is None else self.model.friction.law

    @property
    def overclosure(self) -> Overclosure:
        """Penetration at the first pairing: its ``depth``, and the ``part`` that is allowed."""
        return self.model.overclosure

    @property
    def symmetric(self) -> bool:
        """Whether what contact adds to the tangent is symmetric."""
        return self.model.symmetric

    # --- Pairing

    def update(self) -> None:
        """Pair anew, after the meshes of the bodies have been moved. Collective.

        Displacements then count from the moved meshes, those of :meth:`set_offset` are forgotten. A
        tie of displacements keeps its pairs, and counts what meshes and tool have moved since it
        was made. Forces and gaps stay those of the last solve until the next one.

        Raises:
            ValueError: If coordinates are not finite or a facet has no area.
        """
        with interrupt.heeded(self.comm):
            motion.pair_anew(self.model)

    def allow_overclosure(self, part: float) -> None:
        """Set the part of the initial overclosure that is not resolved, from 0 to 1. Collective.

        Ramped from 1 to 0 over some solves, or in a stepper's ``drive``, it shrinks an interference
        fit on gradually, where bodies are nonlinear or overclosed by much of an element.

        Raises:
            ValueError: If it is not from 0 to 1, the same on all ranks.
        """
        self.model.overclosure.allow(self.comm, part)
        keep(self.model)
        overclosed.follow(self.model, self.model.paired)

    @property
    def version(self) -> int:
        """Counts the pairings made so far."""
        return self.model.num_pairings

    @property
    def search_radius(self) -> float:
        """Distance (length) beyond which nothing is paired; by default the largest of any place."""
        return self.model.paired.search_radius

    @property
    def pairing(self) -> Pairing:
        """Pairing points that were found from nodes this rank owns; those of the first pass."""
        return self.pairings[0]

    @property
    def pairings(self) -> list[Pairing]:
        """Pairing points of every pass: two for double-pass contact, otherwise one."""
        return [Pairing.from_cpp(p.points) for p in self.model.of_sides]

    @property
    def num_unpaired(self) -> int:
        """Nodes that were searched and found no partner, over all passes and ranks. Collective."""
        return int(self.comm.allreduce(sum(p.points.num_unpaired for p in self.model.of_sides)))

    # --- Penalty

    @property
    def penalty(self) -> float | None:
        """ε, stress per length; None as long as an automatic one has not been computed."""
        return self.model.penalty.value

    @property
    def penalty_source(self) -> str:
        """How ε was chosen."""
        return self.model.penalty.source

    @property
    def has_automatic_penalty(self) -> bool:
        """Whether ε is, or is going to be, computed from the stiffness of the bodies."""
        return self.model.penalty.automatic

    @property
    def stiffness(self) -> tuple[float, ...]:
        """Mean K_kk / S_k (stress per length) at the contact nodes, when matrices were last made.

        Of the slave, and of a deformable master.
        """
        return self.model.penalty.stiffness

    @property
    def eps(self) -> float:
        """The penalty as a number.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        return self.model.eps if self.augmented else self.model.penalty.eps

    @property
    def tangential_penalty(self) -> float:
        """ε in tangential direction; only with friction."""
        return self.model.tangential_eps

    def set_penalty(self, penalty: float) -> None:
        """Set ε, stress per length, for the solves to come. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks.
        """
        with checked(self.comm) as same:
            same(POSITIVE, penalty=penalty)
        keep(self.model)
        self.model.penalty.set(penalty)

    def reset(self) -> None:
        """Forget the multipliers, friction, and what a law remembers."""
        multipliers.reset(self.model)

    # --- Motion

    @property
    def unknown(self) -> tuple[str, str]:
        """``"displacement"`` or ``"velocity"``, of the slave's and of the master's body."""
        return self.model.kinematics.unknown

    @property
    def dt(self) -> float | None:
        """Δt, time; None if nothing depends on it."""
        return self.model.kinematics.dt

    @property
    def scale(self) -> tuple[float, float]:
        """Displacement per unknown of the slave's and the master's body: 1 or Δt."""
        return self.model.kinematics.scale

    @property
    def offset(self) -> tuple[PETSc.Vec | None, PETSc.Vec | None]:
        """Displacements (length) on top of those of the unknowns, see :meth:`set_offset`."""
        return self.model.offset or (None, None)

    def set_dt(self, dt: float) -> None:
        """Set Δt (time) for the solves to come. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks, or nothing
                depends on it.
        """
        with checked(self.comm) as same:
            self.model.kinematics.check_dt(dt)
            same(dt=dt)
        self.model.kinematics.dt = dt
        motion.set_motion(self.model)

    def set_offset(self, slave: fem.Function | None, master: fem.Function | None) -> None:
        """Set displacements (length) on top of those of the unknowns: u = scale · x + offset.

        For time stepping: from the meshes as they are, contact then sees the displacements to the
        end of the step, whatever part of the step the meshes have been moved already. Collective.

        Args:
            slave: On the space of the slave's body (the mixed one, if its surface has a sub-space),
                read now; None for no offset.
            master: The same for the master.

        Raises:
            ValueError: If a space is not that of the body.
        """
        motion.set_offset(self.model, slave, master)

    # --- At nodes

    @property
    def _shown(self) -> ContactModel:
        """What there is to read: the last solve, whatever has been changed since."""
        return shown(self.model)

    def gap(self, side: str = "slave") -> Array:
        """Signed distance (length, positive in penetration) of this rank's nodes. Collective.

        The true one, between the facets as the last evaluation has deformed and moved them; see
        :meth:`weighted_gap` for what the law of contact sees. It is measured when it is asked for,
        as when pairing at nodes: to the nearest facet within the search radius that faces the node
        and is not hidden, or to the shape of a tool; beside a rim to the plane of the facet there.

        Args:
            side: ``"slave"``, or ``"master"`` unless that is a rigid tool.

        Returns:
            In the order of ``surface.node_x``, shape (nodes,), NaN where nothing is in reach. For
            tied contact the jump, which is :meth:`weighted_gap`.

        Raises:
            ValueError: If a deformed facet has no area, or the side is a rigid tool.
        """
        return results.gap(self._shown, side)

    def weighted_gap(self, side: str = "slave") -> Array:
        """Weighted gap ḡ (length, positive in penetration) at the nodes of this rank.

        What the multipliers act on: a mean around each node, which may be closed where
        :meth:`gap` is not. With constraints at points the mean over the points around each node,
        and collective, as are :meth:`multiplier` and :meth:`active`.

        Args:
            side: Side that carries the multiplier; ``"master"`` with two multipliers only.

        Returns:
            In the order of ``surface.node_x``, shape (nodes,), for tied contact the jump, (nodes,
            gdim). NaN where a node has no pairing point,
            or with an augmented Lagrangian hardly any of its area is covered.
        """
        return results.weighted_gap(self._shown, side)

    def multiplier(self, side: str = "slave") -> Array:
        """Multiplier λ (stress) at the nodes of this rank, 0 where unpaired; shaped as ḡ.

        λ is what enforces the contact, not the contact pressure: see :meth:`traction`, which also
        has the forces of vertices at creases; their multipliers are not among these.
        """
        return results.multiplier(self._shown, side)

    def memory(self, name: str, side: str = "slave") -> Array:
        """What a law that remembers has of the nodes of this rank since the last step, (nodes,).

        Args:
            name: One of ``law.memory``, see :class:`qs.Law`.
            side: Whose nodes.

        Raises:
            ValueError: If the law remembers nothing of that name.
        """
        return results.memory(self.model, name, side)

    def active(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact, or have a point that is, shape (nodes,).

        Nodes of the slave are whose multiplier vertices and edges at creases have, those of tools
        included, while they bear; what those of a deformable master press on is not. Areas of
        contact, as :meth:`shares` and :meth:`patch` have them, know nothing of such points.
        Among them are nodes that are open between closed ones by less than 1e-3 of a facet, as
        beside edges where the pressure is singular; their multiplier is 0. So are grooves and
        dimples one or two nodes wide that are as flat: ``multiplier() > 0`` leaves them out.
        Collective.
        """
        return results.active(self._shown, side)

    def tangential_multiplier(self, side: str = "slave") -> Array:
        """τ (stress) at the nodes of this rank, (nodes, gdim); friction on the slave is −τ.

        Args:
            side: As for :meth:`weighted_gap`.

        Raises:
            ValueError: If the contact has no friction.
        """
        return results.tangential_multiplier(self._shown, side)

    def slip(self, side: str = "slave") -> Array:
        """Slip (length) over all steps at the nodes of this rank, shape (nodes, gdim).

        Displacement of the slave against the master while in contact, less what is elastic with
        the penalty; see :meth:`tangential_multiplier`.
        """
        return results.slip(self._shown, side)

    def slipping(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact and slip, shape (nodes,).

        Among them are nodes that have a part of the friction of a law that jumps when they open, or
        have lost it, and those between closed ones (see :meth:`active`) if most of these slip; with
        constraints at points those of whose contact more than half slips, see :meth:`shares`. None
        without friction. Collective.
        """
        return results.slipping(self._shown, side)

    def shares(self, side: str = "slave") -> tuple[Array, Array]:
        """Parts of the area S_k of each node of this rank that are in contact, and that slip.

        From 0 to 1. With constraints at points a node may be in contact, and slip, in part; at
        nodes it is or is not. ``closed - slips`` is what sticks; what has left within the step may
        have slipped. Collective.

        Returns:
            Shape (nodes,) each.
        """
        return results.shares(self._shown, side)

    def dissipation(self, side: str = "slave") -> Array:
        """Energy that friction took at each node of this rank in the last step, shape (nodes,)."""
        return results.dissipation(self._shown, side)

    # --- Totals

    def penetration(self) -> float:
        """Depth (length) of the deepest point of either side in the other one. Collective.

        The true one, measured as :meth:`gap` is: at the nodes of both sides, on the overlay also
        at points of its pieces; 0 if nothing penetrates. What is beside the other side does not
        count. With smoothing, depths are those of the curved surfaces at the points. Of a tied
        contact it is the largest jump.

        Raises:
            ValueError: If a deformed facet has no area.
        """
        return results.penetration(self._shown)

    def weighted_penetration(self) -> float:
        """Largest weighted gap (length) of the slave, 0 if all are open; of a tied one its size.

        Collective.
        """
        return results.weighted_penetration(self._shown)

    def stored_energy(self) -> float:
        """Energy Φ of the gaps at the last evaluation; of the augmented Lagrangian if that is used.

        Over all ranks. Collective.
        """
        return results.energy(self._shown)

    @property
    def energy(self) -> float:
        """The same as :meth:`stored_energy`, by its name of before. Collective."""
        return self.stored_energy()

    def step_dissipation(self) -> float:
        """Energy that friction took in the last step. Collective."""
        return results.step_dissipation(self._shown)

    def dissipated_energy(self) -> float:
        """Energy that friction has taken in all steps that have ended. Collective."""
        friction = self.model.friction
        return 0.0 if friction is None else friction.dissipated_energy()

    def patch(self) -> tuple[float, float]:
        """Size of the contact at the last evaluation. Collective.

        Returns:
            Area of the slave's nodes in contact (see :meth:`active`), Σ S_k, or points, Σ w_p (2D:
            length), those that :meth:`traction` stands for; and the radius of a disc of this area
            (2D: half the length).
            Known to about half a facet at the rim; grooves and dimples one or two nodes wide that
            are open by less than 1e-3 of a facet count as contact.
        """
        return results.patch(self._shown)

    def force(self, side: str) -> Array:
        """Total contact force on the body of one side, shape (gdim,). Collective.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return results.force(self._shown, side)

    def flow(self, side: str) -> float:
        """Of scalar fields: total flow, such as heat per time, into the body of one side.

        Heat of friction is part of it. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Raises:
            ValueError: If it is a contact of displacements or velocities.
        """
        return results.flow(self._shown, side)

    def flux(self, side: str) -> fem.Function:
        """Of scalar fields: flow per area into the body of one side, recovered. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, f_k / S_k of the flows f_k at the nodes; 0 off the surface.

        Raises:
            ValueError: If it is a contact of displacements, or the side is a rigid tool.
        """
        return results.flux(self._shown, side)

    def moment(self, side: str, about: npt.ArrayLike | None = None) -> Array:
        """Total moment of the contact forces on the body of one side. Collective.

        Forces act where contact was detected, the places that their normals belong to: all of a
        frictionless round tool go through its axis, and those of two bodies balance, unless they
        are tied, or have friction, across a gap: by its length times the force along it. With
        ``sliding="finite"`` that is where the bodies are. In the steps of a ``qs.TimeStepper``
        contact with bodies in velocities is detected after the part θ of a step; forces on a rigid
        tool then go along with its centre to the end of the step.

        Args:
            side: ``"slave"`` or ``"master"``.
            about: Point, shape (gdim,); by default the centre of a rigid tool, in time steps at the
                end of the step, or the origin.

        Returns:
            Shape (3,), in 2D (1,).
        """
        return results.moment(self._shown, side, about)

    def traction(self, side: str, part: str = "whole") -> fem.Function:
        """Traction t (stress) recovered from the contact forces. Collective.

        Args:
            side: ``"slave"`` or ``"master"``: the traction that acts on this body.
            part: Of the forces: ``"whole"``, those of the gaps, ``"normal"``, or those of friction,
                ``"tangential"``.

        Returns:
            Function of degree 1, zero off the surface; its values there are
            ``surface.node_values(traction)``. Its space is that of the surface, collapsed if that
            is a sub-space, if it is Lagrange of degree 1. Else it is a new one: for P1 with bubbles
            and for degree 2, of which nodal forces f_k are then those conjugate to this space.

            It is t_k = f_k / S_k, of a ring the force on it over 2πr times a length. The area S_k:

            - of a body in displacements in time steps, where it is at the end of the step: present
              force per present area (Cauchy's traction);
            - in other solves with ``sliding="small"``, that of the mesh when contact was
              paired. The traction is nominal then, force per area of the mesh, as the stresses of
              small strains are;
            - with ``sliding="finite"``: where the body is at the end of the solve or step;
            - of a body in velocities with small sliding: of the mesh that it was solved for on, in
              time steps that after the part ``theta`` of the step.

            It does not depend on the degree of displacements.
        """
        return results.traction(self._shown, side, part)

    def pressure(self, side: str) -> fem.Function:
        """Contact pressure p = −t·n (stress), positive where bodies press each other. Collective.

        Of :meth:`traction` without friction, along the outward normals n of the side's vertices
        where its facets are; at an edge that is a mean of those around. Ties may pull: p < 0.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Scalar Lagrange function of degree 1, zero off the surface; at its nodes
            ``surface.node_values(pressure)``, shape (nodes,). Per the area that :meth:`traction`
            is of.

        Raises:
            ValueError: If the side is a rigid tool.
        """
        return results.pressure(self._shown, side)

    # --- Fields

    def status(self, side: str = "slave") -> fem.Function:
        """Status of each node: 0 unpaired, 1 open, 2 active or sticking, 3 slipping. Collective.

        The numbers are those of ``qs.Status``. On a side without multipliers, the master of
        master-slave and quasi-symmetric contact, nodes that a force reaches are active, and
        slipping if more than half of what they face slips. As long as an automatic penalty is not
        known, before the first solve, nothing is in contact and all paired nodes are open.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, zero off the surface.
        """
        return fields.status(self._shown, side)

    def gap_function(self, side: str = "slave") -> fem.Function:
        """The weighted gap as a Function; of tied contact the size of the jump. Collective.

        Args:
            side: ``"slave"`` or ``"master"``. On a side without multipliers it is the mean of the
                other side's gap over what a node faces.

        Returns:
            Function of degree 1 (length, positive in penetration), zero off the surface and where
            :meth:`status` is 0.
        """
        return fields.gap_function(self._shown, side)

    def field_sources(self, side: str = "slave") -> dict[str, typing.Callable[[], fem.Function]]:
        """Functions that return the fields of :meth:`fields` anew, for :class:`qs.FieldWriter`.

        ``qs.FieldWriter("die.xdmf", mesh, {"u": u} | contact.field_sources("master"))`` writes them
        all, as they are at each time.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return fields.sources(self.model, side)

    def fields(self, side: str = "slave") -> dict[str, fem.Function]:
        """Fields to look at: traction, pressure, gap and status. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Functions of degree 1, zero off the surface, whatever the space of the body:
            ``"traction"`` (stress, a vector), ``"pressure"`` (stress), ``"gap"`` (length, the
            weighted one, see :meth:`gap_function`) and ``"status"`` (0 unpaired, 1 open, 2 active,
            3 slipping, see :meth:`status`). With friction also the parts of the traction,
            ``"normal_traction"`` and ``"tangential_traction"``, and on a side that carries
            multipliers ``"slip"`` (length, a vector).
        """
        return {name: source() for name, source in self.field_sources(side).items()}

    def report(self) -> ContactReport:
        """What the contact is and does, to print as a table. Collective.

        Pairing, gaps and active nodes as at the last evaluation, the places that are deepest in
        the other side, nodes that no force reaches; the penalty, and the sizes of surfaces, as they
        are now. The same on all ranks; it costs about as much as pairing anew.
        """
        return make_report(self._shown, self.model.penalty)

    @property
    def seconds(self) -> float:
        """Wall time (s) that this rank has spent in pairing, gaps and insertion."""
        return sum(self.model.watch.seconds.values())
