"""Contact between two surfaces: formulation, contact law, penalty and results."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import POSITIVE, check, require
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import motion, overclosed
from qsdolfinx.contact.advice import AT_FIRST
from qsdolfinx.contact.arguments import SLAVE
from qsdolfinx.contact.findings import look
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
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface

Array = npt.NDArray[np.float64]


class Contact:
    """Contact of a slave surface with a master surface.

    With the two surfaces alone, contact is quasi-symmetric with exact integrals, and an augmented
    Lagrangian closes the gaps. The method of the paper is ``quadrature="nodal"`` with
    ``enforcement="penalty"``.

    The penalty energy is Φ = ½ ε Σ_k S_k [ḡ_k]₊² over the slave nodes k. The formulations differ
    in where the gap is sampled. ``"master-slave"``, (5), samples it on the slave side.
    ``"quasi-symmetric"``, (11) and (12), samples it on both sides, with the multiplier on the slave
    only. ``"double-pass"``, (6), is the mean of two master-slave contacts with the roles swapped,
    so that both sides carry multipliers. These multipliers cannot close every gap of non-matching
    meshes: double-pass contact needs a moderate penalty, and has no augmented Lagrangian.

    The ½ of (11) is kept in the gap, so that ε means the same in every formulation: on matching
    meshes all formulations give the same result. The ρ of (12) is ε/8 for quasi-symmetric contact
    and ε/2 for master-slave contact.

    Contact detection finds the contact quadrature points when the object is made, and again in
    :meth:`update`. Collective.

    The results are in :attr:`results`, a :class:`qs.ContactResults`. The results that are read most
    often are also methods of this class. The arguments are in :attr:`settings`.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool. For self-contact, the same surface as the
            slave: ``contact.slave`` and ``contact.master`` are then two new surfaces on the whole
            boundary of the body, and each facet of the surface may be the master of another one.
        name: Name of the contact in messages, such as ``"punch"``; by default messages give its
            place in the problem's list.
        law: ``Unilateral()``, ``Tied()`` or a :class:`qs.Law` of your own; for scalar fields
            ``Tied()`` or ``Conductance(h)``.
        friction: ``qs.Coulomb``, ``qs.Tresca``, ``qs.CoulombTresca``, ``qs.Norton``,
            ``qs.Sticking``, or None. Slip counts from the end of the last step. A step is one solve
            of the problem, unless the solve is inside ``ContactProblem.one_step``.
        sliding: ``"small"``: contact pairs, normals and areas do not change during a solve.
            ``"finite"``: the geometry of contact is updated within the solve, however far the
            bodies slide or turn; the segmentation of the facets is computed anew in each iteration.
            This needs the overlay and facet normals. By default sliding is small. It becomes finite
            when the contact is used in a problem in which the form of one of its bodies is
            nonlinear, or in a :class:`qs.TimeStepper`. It stays small with velocity-based bodies,
            tools that a moment drives, the nodal rule, ``constraints="nodes"``,
            ``normals="bisector"``, for contacts that have already been solved, where meshes of
            degree 2 with displacements of degree 1 touch surfaces that are curved alike, and, in
            3D, where sharp edges are near edges of the other side and reach it before their facets
            do.
        formulation: ``"master-slave"``, ``"double-pass"`` or ``"quasi-symmetric"``. A rigid tool
            carries no multiplier, so that only the first and the third are possible; with an
            analytic shape these two are the same.
        enforcement: ``"augmented-lagrangian"``, the default except where there is none: the solve
            ends when the gaps that the multipliers leave are within the tolerance, with any
            penalty. The multipliers are kept for the next solve, also when the contact pairs are
            updated; :meth:`reset` deletes them. ``"penalty"``, the default of double-pass contact,
            conductances and laws of your own: a gap of λ/ε is left, or that of the law.
        penalty: ε, stress per length. ``"auto"`` computes it from the stiffness of the bodies at
            the contact nodes in the first solve; with an augmented Lagrangian and velocity-based
            bodies, after each update of the contact pairs.
        friction_penalty: ε in tangential direction (stress per length); by default the penalty of
            the gaps. Not used by ``qs.Norton``.
        gap_tolerance: Largest gap that an augmented Lagrangian may leave at active constraints
            when a solve ends, in units of the smallest facet. With constraints at points it limits
            the mean gaps of the nodes, which are all that the multipliers can close. The gaps of
            the points within a facet still differ from this mean, depending on the mesh size.
        constraints: Where the contact law is evaluated. ``"points"``: at each contact quadrature
            point, for friction too, so that inactive constraints do not change the force of active
            constraints beside them; and at vertices and edges of sharp edges, which touch before
            their facets do. Multipliers are functions on the slave's nodes. ``"nodes"``: at the
            slave nodes, for weighted gaps, with small sliding. The default is ``"points"`` for
            unilateral contact on the overlay and for all contact with finite sliding. It is
            ``"nodes"`` for ties, double-pass contact, nodal quadrature, and a user's law with a
            penalty.
        initial_overclosure: How to treat penetration in the first contact detection, before
            anything has moved. ``"resolve"``: interference fit; the next solve presses the bodies
            apart (with :meth:`allow_overclosure` gradually). ``"ignore"``: strain-free adjustment;
            the penetration never counts as a gap. Each node keeps its depth, without strain,
            wherever it slides. Nodes that the other surface reaches later are allowed the same
            depth if it is the same at all nodes. With finite sliding and constraints at points the
            depth of a node is the mean over the points around it, increased until no point is in
            contact. ``"error"``: penetration raises an error. Points deeper than the search radius
            are not paired, and their penetration is not found. A tie leaves any gap as it is, so
            that ``"resolve"`` and ``"ignore"`` are the same for it.
        search_radius: Search distance (length): points further than this from the other surface are
            not paired. By default the largest facet of the two surfaces; with a rigid tool the
            largest facet of the slave; with finite sliding four times that; at least twice the
            opening at which a law of your own ends, if its penalty is a number. ``"local"``: at
            each place the size of the larger of the two facets, for surfaces with fine parts that
            need only a short search distance.
        quadrature: ``"overlay"``: (7) is integrated exactly over the segments, the intersections of
            the facets of the two surfaces. ``"nodal"``, the method of the paper: the gap is sampled
            at nodes, as in (5), (6), (12), for displacements of degree 1. It is cheaper, but on
            non-matching meshes tractions have a relative error that does not fall with the size of
            facets.
        quadrature_degree: Degree of the rule on the segments of the overlay. By default the degree
            of the integrand on affine facets; with ``sliding="finite"`` between quadrilaterals 2,
            or 4 with displacements of degree 2.
        normals: Direction in which the gap is measured. ``"facet"``: the normal of the facet that
            was found or cut (the default at nodes without friction). ``"bisector"``: the bisector
            of this normal and the mean normal at the node or point of the other surface (the
            default on the overlay with small sliding, and with friction: along a tilted facet
            normal, closing a gap would count as slip). Bisectors are for two deformable bodies. A
            rigid tool, of facets or analytic, always gives its own normals, at the closest or
            opposite point.
        unknown: Unknowns of the bodies: ``"displacement"`` or ``"velocity"``, (2) and (3), or a
            pair for slave and master, such as ``("velocity", "displacement")`` for a forged
            workpiece and an elastic die.
        dt: Δt, time. Needed if a body has velocities, if friction depends on rates, or for the heat
            of friction if the contact in ``mechanics`` has no Δt; :meth:`set_dt` changes it.
        mechanics: For contact of scalar fields: the mechanical contact of the bodies, on the same
            facets. The field uses the contact pairs of this contact, so that contact detection is
            done once. A conductance uses its pressures, distances and friction. If the master is a
            rigid tool with a mesh of its own for the field, the field has its own contact
            detection, at the positions of the meshes.
        of: Former name of ``mechanics``.
        smoothing: Removed, see :func:`qs.elevate`: any value but None is an error.

    Surfaces on scalar spaces, such as temperatures, have no gaps: ``qs.Tied()``, the default, makes
    the field continuous, and ``qs.Conductance(h)`` lets a flux h ⟦T⟧ through. λ, with the sign of
    ⟦T⟧ = T_s − T_m, is then the flux from the slave to the master; see :meth:`flux` and
    :meth:`flow`. The arguments for displacements and forces above do not apply.

    Raises:
        ValueError: If a name is unknown, the penalty or the radius is not positive, the two
            surfaces share facets or differ in dimension or communicator.
        TypeError: If a surface or the law is of another type.

    Warns:
        ContactWarning: If hardly any node is paired; if the master is much finer than the slave and
            sampled at nodes (the first solve also warns of a finer slave with a soft penalty); if
            facets of a tool look reversed; if the surfaces penetrate each other deeply; or if the
            chord error of facets on conforming surfaces is not small compared with their clearance
            or interference.

    Attributes:
        results: Results of the last solve.
        model: The parts of the contact, for the problem and for extensions of the library.
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
        # What unknowns mean.
        unknown: str | typing.Sequence[str] = "displacement",
        dt: float | None = None,
        mechanics: Contact | None = None,
        of: Contact | None = None,
        smoothing: None = None,
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
            unknown,
            dt,
            mechanics,
            of,
            smoothing,
        )
        self.model: ContactModel = make(choose(given))
        self.results = ContactResults(self.model)
        motion.pair_anew(self.model)
        look(self.model, AT_FIRST)

    def __repr__(self) -> str:
        """Its name, formulation and surfaces."""
        if "model" not in self.__dict__:
            return "<Contact>"
        name = "" if self.name is None else f" {self.name!r}"
        master = "itself" if self.model.with_itself else type(self.master).__name__
        return f"<Contact{name}: {self.model.settings.formulation}, with {master}>"

    def __setattr__(self, name: str, value: typing.Any) -> None:
        """Refuse to set arguments and results."""
        if name not in ("model", "results"):
            how = {"penalty": "set_penalty(ε)", "dt": "set_dt(Δt)"}.get(name)
            remedy = f"call {how}" if how else "make another contact"
            raise AttributeError(f"contact.{name}: cannot be set; {remedy}")
        super().__setattr__(name, value)

    def __getattr__(self, name: str) -> typing.Any:
        """Return any result of :attr:`results`, or an attribute that has moved, by its old name."""
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
        """Name of the contact in messages."""
        return self.model.name

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.model.comm

    @property
    def law(self) -> Law:
        """Contact law: gives the multiplier for a gap."""
        return self.model.law

    @property
    def friction(self) -> Friction | None:
        """The law of friction; None without friction."""
        return None if self.model.friction is None else self.model.friction.law

    @property
    def sliding(self) -> str:
        """Kind of sliding: ``"small"``, or ``"finite"`` with updated contact geometry.

        If the argument was not given, a problem with nonlinear bodies or a time stepper makes it
        finite.
        """
        return self.model.settings.sliding

    @property
    def dt(self) -> float | None:
        """Δt, time; None if nothing depends on it."""
        return self.model.kinematics.dt

    @property
    def settings(self) -> ContactSettings:
        """All arguments, with the values chosen for those not given, and the present Δt."""
        return settings_of(self.model)

    # --- Pairing

    def update(self) -> None:
        """Update the contact pairs, after the meshes of the bodies have been moved. Collective.

        Displacements then count from the moved meshes; those of :meth:`set_offset` are deleted. A
        tie of displacements keeps its pairs, and adds the motion of the meshes and the tool since
        the tie was made. Forces and gaps stay those of the last solve until the next solve.

        Raises:
            ValueError: If coordinates are not finite or a facet has no area.
        """
        with interrupt.heeded(self.comm):
            motion.pair_anew(self.model)

    def allow_overclosure(self, part: float) -> None:
        """Set the part of the initial overclosure that is not resolved, from 0 to 1. Collective.

        Reduce it from 1 to 0 over several solves, or in the ``drive`` of a stepper, to apply an
        interference fit gradually. This is needed where bodies are nonlinear, or where the
        overclosure is a large part of an element.

        Raises:
            ValueError: If ``part`` is not from 0 to 1, or differs between ranks, or if the contact
                is one of scalar fields, which have no overclosure.
        """
        require(not self.model.is_scalar, "allow_overclosure: scalar fields have no overclosure")
        self.model.overclosure.allow(self.comm, part)
        keep(self.model)
        overclosed.follow(self.model, self.model.paired)

    @property
    def pairing(self) -> Pairing:
        """Contact quadrature points of this rank; in double-pass contact of the slave side."""
        return self.model.pairings[0]

    @property
    def num_unpaired(self) -> int:
        """Nodes without a partner, over all integration sides and ranks. Collective."""
        found = sum(gap.points.num_unpaired for gap in self.model.of_sides)
        return int(self.comm.allreduce(found))

    # --- Penalty, multipliers, time

    @property
    def penalty(self) -> float | None:
        """ε, stress per length; None until an automatic penalty has been computed."""
        return self.model.penalty.value

    def set_penalty(self, penalty: float) -> None:
        """Set ε, stress per length, for the next solves. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks.
        """
        with checked(self.comm) as same:
            same(POSITIVE, penalty=penalty)
        keep(self.model)
        self.model.penalty.set(penalty)

    def reset(self) -> None:
        """Delete the multipliers, the history of friction and the history variables of laws.

        The next solve is as the first solve of a new contact with the same contact pairs and
        penalty: nothing has slipped, slip counts from the unknowns at the start of this solve, and
        :meth:`dissipated_energy` is 0. Other results stay those of the last solve until then.
        Contact pairs found at other positions of the meshes need :meth:`update` as well, before or
        after. Collective.
        """
        motion.reset(self.model)

    def set_dt(self, dt: float) -> None:
        """Set Δt (time) for the next solves. Collective.

        Raises:
            ValueError: If it is not a positive number, differs between ranks, or nothing depends
                on it.
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
        """Return a report of the contact, to print as a table. Collective.

        Contact pairs, gaps, active nodes, the places of deepest penetration and the nodes that no
        force reaches are those of the last evaluation. The penalty and the sizes of the surfaces
        are the present ones. The report is the same on all ranks. It costs about as much as contact
        detection.
        """
        return make_report(shown(self.model), self.model.penalty)
