"""Contact between two surfaces: formulation, law, penalty, and what there is to read afterwards."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import POSITIVE, check
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import motion, multipliers, overclosed
from qsdolfinx.contact.advice import advise, tell_smoothed
from qsdolfinx.contact.arguments import SLAVE
from qsdolfinx.contact.making import Arguments, choose, make
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.moved import moved
from qsdolfinx.contact.readings import ContactResults
from qsdolfinx.contact.report import ContactReport, make_report
from qsdolfinx.contact.settings import ContactSettings, settings_of
from qsdolfinx.contact.shown import keep, shown
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.laws import Law
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.pairing.relief import Side
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface

Array = npt.NDArray[np.float64]


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

    What there is to read afterwards is in :attr:`results`, a :class:`qs.ContactResults`; the dozen
    that is read most is here, too. What the contact was made with is in :attr:`settings`.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool; or the same surface, parts of which may come to
            touch each other: it then stands for all facets that are the master of another one,
            and ``slave`` and ``master`` are surfaces of their own, of all of the body's boundary.
        name: What messages call the contact, such as ``"punch"``; by default its place in the
            problem's list.
        law: ``Unilateral()``, ``Tied()`` or a :class:`qs.Law` of your own; of scalar fields
            ``Tied()`` or ``Conductance(h)``.
        friction: ``qs.Coulomb``, ``qs.Tresca``, ``qs.CoulombTresca``, ``qs.Norton``,
            ``qs.Sticking``, or None. Slip counts from the end of the last step: a step is a solve
            of the problem, unless the solve is part of ``ContactProblem.one_step``.
        sliding: ``"small"``: pairs, normals and areas stay as they were paired while a solve lasts.
            ``"finite"``: the geometry of contact follows the bodies within the solve, however far
            they slide or turn; facets are cut anew at each iteration. It needs the overlay, with
            normals of the facets. By default small, and finite as soon as it is part of a problem
            where the form of one of its bodies is nonlinear, or of a :class:`qs.TimeStepper`: but
            for bodies in velocities, tools that a moment drives, the nodal rule,
            ``constraints="nodes"``, ``smoothing``, ``normals="bisector"``, contacts that have been
            solved for already, and, in 3D, creases that are near edges of the other side,
            ahead of their facets.
        formulation: ``"master-slave"``, ``"double-pass"`` or ``"quasi-symmetric"``. A rigid tool
            carries no multiplier, so that only the first and the third are possible; with an
            analytic shape they are the same.
        enforcement: ``"augmented-lagrangian"``, the default where there is one: multipliers are
            updated until they leave no gap larger than the tolerance, with any penalty. (With
            direct solvers a penalty that takes too many updates is raised.) They are
            kept for the next solve, also when contact pairs anew; :meth:`reset` forgets them.
            ``"penalty"``, the default of double-pass contact: a gap of λ/ε is left.
        penalty: ε, stress per length; ``"auto"`` takes it from the stiffness of the bodies at the
            contact nodes when the problem is first solved; with an augmented Lagrangian and bodies
            in velocities, whenever contact has paired anew.
        friction_penalty: ε in tangential direction (stress per length); by default that of the
            gaps. Not used by ``qs.Norton``.
        gap_tolerance: Gap that an augmented Lagrangian may leave, in units of the smallest facet.
            Where that is more than 1e-4 of λ/ε, as under small loads, this is the limit; where a
            body with held nodes is tied to a much stiffer one, what stands for 1e-5 of the largest
            λ in that. With constraints at points it is a limit for what multipliers can close: the
            mean gaps of nodes. What points within a facet differ by stays, as resolution allows.
        constraints: Where the law is asked for a multiplier. ``"points"``: at each contact
            quadrature point, that of friction too, so that what is open takes nothing from what is
            closed beside it, and at vertices and edges of creases, which are ahead of their facets;
            multipliers are functions on the slave's nodes. ``"nodes"``: at the slave nodes, for
            weighted gaps, with small sliding. By default ``"points"`` of unilateral contact on the
            overlay, and of all that follows the bodies; ties, double-pass contact, nodal
            quadrature, and a law of the user's with a penalty have ``"nodes"``.
        initial_overclosure: What becomes of penetration at the first pairing, before anything has
            moved. ``"resolve"``: it is a misfit as any other, and the next solve presses the bodies
            apart (an interference fit; :meth:`allow_overclosure` does so gradually). ``"ignore"``:
            it never counts as a gap: each node keeps its depth, without strain, wherever it slides,
            and nodes that the other surface slides to get the same if all are as deep. With finite
            sliding at points that is the mean of the points around it, and as much more as it takes
            for none of them to press. ``"error"``: it is refused. Points deeper than the search
            radius are not paired, and not seen. A tie leaves any gap as it is; with it the first
            two are the same.
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
            node or point of the other surface (the default on the overlay with small sliding, and
            with friction, which takes closing a gap along a tilted facet's normal for slip).
            Bisectors are for two deformable bodies: of a rigid tool, of facets or analytic, the
            normals are always its own, at the point that is closest or opposite; if it is smoothed,
            those of its surface.
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
        unknown: What the unknowns of the bodies are: ``"displacement"`` or ``"velocity"``, (2) and
            (3), or one of them for the slave and the master, such as a forged workpiece and an
            elastic die, ``("velocity", "displacement")``.
        dt: Δt, time, if a body has velocities or friction depends on rates, or for the heat of
            friction if the contact in ``mechanics`` has none; :meth:`set_dt` changes it.
        mechanics: For contact of scalar fields: the contact of the bodies, on the same facets. The
            field has its pairs, so that nothing is searched twice, and a conductance its pressures,
            distances and friction. Where its master is a rigid tool that has a
            mesh of its own for the field, fields are paired by themselves, where meshes are.
        of: ``mechanics``, as it was called before.

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
        results: What there is to read after a solve.
        model: The parts, for the problem and for those who extend the library.
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface | RigidSurface,
        *,
        name: str | None = None,
        law: Law | None = None,
        friction: Friction | None = None,
        sliding: str | None = None,
        # How it is enforced.
        formulation: str = "quasi-symmetric",
        enforcement: str | None = None,
        penalty: float | str = "auto",
        friction_penalty: float | None = None,
        gap_tolerance: float = 1e-8,
        constraints: str | None = None,
        initial_overclosure: str = "resolve",
        # Where the gap is measured.
        search_radius: float | str | None = None,
        quadrature: str = "overlay",
        quadrature_degree: int | None = None,
        normals: str | None = None,
        smoothing: Side | tuple[Side, Side] = "auto",
        # What unknowns mean.
        unknown: str | typing.Sequence[str] = "displacement",
        dt: float | None = None,
        mechanics: Contact | None = None,
        of: Contact | None = None,
    ) -> None:
        check(SLAVE, slave=slave)
        given = Arguments(
            slave,
            master,
            name,
            law,
            friction,
            sliding,
            formulation,
            enforcement,
            penalty,
            friction_penalty,
            gap_tolerance,
            constraints,
            initial_overclosure,
            search_radius,
            quadrature,
            quadrature_degree,
            normals,
            smoothing,
            unknown,
            dt,
            mechanics,
            of,
        )
        made = make(choose(given))
        self.model: ContactModel = made.model
        self.results = ContactResults(self.model)
        self._smoothing = made.smoothing
        motion.pair_anew(self.model)
        advise(self.model)
        if made.alike is not None:
            tell_smoothed(self.model, made.alike)

    def __repr__(self) -> str:
        """Its name, formulation and surfaces."""
        if "model" not in self.__dict__:
            return "<Contact>"
        name = "" if self.name is None else f" {self.name!r}"
        master = "itself" if self.model.with_itself else type(self.master).__name__
        return f"<Contact{name}: {self.model.settings.formulation}, with {master}>"

    def __setattr__(self, name: str, value: typing.Any) -> None:
        """Refuse to set what it was made with, or what is read."""
        if name not in ("model", "results", "_smoothing"):
            how = {"penalty": "set_penalty(ε)", "dt": "set_dt(Δt)"}.get(name)
            remedy = f"call {how}" if how else "make another contact"
            raise AttributeError(f"contact.{name}: cannot be set; {remedy}")
        super().__setattr__(name, value)

    def __getattr__(self, name: str) -> typing.Any:
        """Any result of :attr:`results`, and what has moved from here, by its name of before."""
        if name.startswith("_") or "results" not in self.__dict__:
            raise AttributeError(f"Contact has no attribute {name!r}", name=name, obj=self)
        if hasattr(ContactResults, name):
            return getattr(self.results, name)
        return moved(self, name)

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
    def name(self) -> str | None:
        """What messages call it."""
        return self.model.name

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.model.comm

    @property
    def law(self) -> Law:
        """From the gap to the multiplier."""
        return self.model.law

    @property
    def friction(self) -> Friction | None:
        """The law of friction, None without."""
        return None if self.model.friction is None else self.model.friction.law

    @property
    def sliding(self) -> str:
        """``"small"``, or ``"finite"``: contact's geometry follows the bodies.

        If it was left open, a problem with nonlinear bodies, or a time stepper, makes it finite.
        """
        return self.model.settings.sliding

    @property
    def dt(self) -> float | None:
        """Δt, time; None if nothing depends on it."""
        return self.model.kinematics.dt

    @property
    def settings(self) -> ContactSettings:
        """The other arguments, with what they have left open, and Δt as it is now."""
        return settings_of(self.model, self._smoothing)

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
    def pairing(self) -> Pairing:
        """Pairing points found from nodes this rank owns, of double-pass contact the slave's."""
        return self.model.pairings[0]

    @property
    def num_unpaired(self) -> int:
        """Nodes that were searched and found no partner, over all passes and ranks. Collective."""
        found = sum(gap.points.num_unpaired for gap in self.model.of_sides)
        return int(self.comm.allreduce(found))

    # --- Penalty, multipliers, time

    @property
    def penalty(self) -> float | None:
        """ε, stress per length; None as long as an automatic one has not been computed."""
        return self.model.penalty.value

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

    # --- What is read most

    def force(self, side: str) -> Array:
        """Total contact force, (gdim,): :meth:`ContactResults.force`. Collective."""
        return self.results.force(side)

    def moment(self, side: str, about: npt.ArrayLike | None = None) -> Array:
        """Total moment, (3,) or (1,): :meth:`ContactResults.moment`. Collective."""
        return self.results.moment(side, about)

    def traction(self, side: str, part: str = "whole") -> fem.Function:
        """Traction (stress): :meth:`ContactResults.traction`. Collective."""
        return self.results.traction(side, part)

    def pressure(self, side: str) -> fem.Function:
        """Contact pressure (stress): :meth:`ContactResults.pressure`. Collective."""
        return self.results.pressure(side)

    def gap(self, side: str = "slave") -> Array:
        """Signed distance of the nodes (length): :meth:`ContactResults.gap`. Collective."""
        return self.results.gap(side)

    def active(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes in contact: :meth:`ContactResults.active`. Collective."""
        return self.results.active(side)

    def penetration(self) -> float:
        """Depth of the deepest point (length): :meth:`ContactResults.penetration`. Collective."""
        return self.results.penetration()

    def stored_energy(self) -> float:
        """Energy of the gaps: :meth:`ContactResults.stored_energy`. Collective."""
        return self.results.stored_energy()

    def dissipated_energy(self) -> float:
        """Work of friction in all steps: :meth:`ContactResults.dissipated_energy`. Collective."""
        return self.results.dissipated_energy()

    def fields(self, side: str = "slave") -> dict[str, fem.Function]:
        """Traction, pressure, gap and status: :meth:`ContactResults.fields`. Collective."""
        return self.results.fields(side)

    def report(self) -> ContactReport:
        """What the contact is and does, to print as a table. Collective.

        Pairing, gaps and active nodes as at the last evaluation, the places that are deepest in
        the other side, nodes that no force reaches; the penalty, and the sizes of surfaces, as they
        are now. The same on all ranks; it costs about as much as pairing anew.
        """
        return make_report(shown(self.model), self.model.penalty)
