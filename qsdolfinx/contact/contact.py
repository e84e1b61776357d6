"""Contact between two surfaces: formulation, law, penalty, and what there is to read afterwards."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import check_choice, check_positive
from qsdolfinx.base.collective import check_agreement, collective_errors
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact.advice import advise
from qsdolfinx.contact.arguments import check_friction, check_surfaces
from qsdolfinx.contact.motion import ContactMotion
from qsdolfinx.contact.penalty import automatic_penalty, source
from qsdolfinx.contact.report import ContactReport, make_report
from qsdolfinx.contact.results import TWO_PASSES
from qsdolfinx.friction.history import Tangential
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.kinematics import Kinematics
from qsdolfinx.gap.laws import Law, Unilateral
from qsdolfinx.gap.overclosure import Overclosure
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.pair import NORMALS, QUADRATURES, check_quadrature, pair
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.surface.surface import Surface, update_surfaces
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
T = typing.TypeVar("T")

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")

#: Gaps smaller than this part of the smallest facet count as closed.
TOUCHING = 1e-12


class Contact(ContactMotion):
    """Contact of a slave surface with a master surface by the penalty method.

    The energy is Φ = ½ ε Σ_k S_k [ḡ_k]₊² over the slave nodes k. The formulations differ in where
    the gap is sampled: ``"master-slave"``, (5), at the slave nodes; ``"quasi-symmetric"``, (11) and
    (12), at the nodes of both sides, while the multiplier stays on the slave; ``"double-pass"``,
    (6), is the mean of two master-slave contacts with the roles swapped, and so has multipliers on
    both sides. ``"two-half-pass"`` (Sauer & De Lorenzis 2013) has multipliers on both sides too,
    each of which loads its own side alone: the tangent is not symmetric, and forces balance only as
    far as both sides see the same gap. Two multipliers cannot close every gap of non-matching
    meshes: use a moderate penalty with these two.

    The ½ of (11) is kept in the gap, so that ε means the same in every formulation: matching meshes
    give the same result with each. The ρ of (12) is ε/8 for quasi-symmetric contact and ε/2 for
    master-slave.

    Pairing points are found when the object is made, and again by :meth:`update`. Collective.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        formulation: ``"master-slave"``, ``"double-pass"``, ``"quasi-symmetric"`` or
            ``"two-half-pass"``. A rigid tool carries no multiplier, so that only the first and the
            third are possible; with an analytic shape they are the same.
        law: ``Unilateral()`` or ``Tied()``.
        penalty: ε, stress per length; ``"auto"`` takes it from the stiffness of the bodies at the
            contact nodes when the problem is first solved; with an augmented Lagrangian and bodies
            in velocities, whenever contact has paired anew.
        search_radius: Points further than this from the other surface are not paired (length). By
            default the largest facet size of the two surfaces; analytic shapes have no facets.
        quadrature: ``"nodal"``: the gap is sampled at nodes, as in (5), (6), (12).
            ``"overlay"``: (7) is integrated exactly over the pieces that the facets of one surface
            cut from those of the other; needed for displacements of degree 2.
        quadrature_degree: Degree of the rule on the pieces of the overlay; by default that of the
            integrand on affine facets.
        normals: Along which the gap is measured: ``"facet"``, of the facet that is found or cut
            (the default at nodes without friction); ``"averaged"`` at the nodes of the other, or of
            the cut, surface; ``"bisector"`` of the normals of both (the default on the overlay, and
            with friction, which takes closing a gap along a tilted facet's normal for slip). Those
            of an analytic shape are always its own, at the point that is closest.
        enforcement: ``"penalty"``, or ``"augmented-lagrangian"``: multipliers are updated until
            they leave no gap larger than the tolerance. They are kept for the next solve, also
            when contact pairs anew; :meth:`reset` forgets them.
        gap_tolerance: That gap in units of the smallest facet.
        unknown: What the unknowns of the bodies are: ``"displacement"`` or ``"velocity"``, (2) and
            (3), or one of them for the slave and the master, such as a forged workpiece and an
            elastic die, ``("velocity", "displacement")``.
        dt: Δt, time, if a body has velocities or friction depends on rates; :meth:`set_dt` changes
            it.
        friction: ``qs.Coulomb``, ``qs.Tresca``, ``qs.CoulombTresca``, ``qs.Norton``,
            ``qs.Sticking``, or None. Slip counts from the end of the last step: a step is a solve
            of the problem, unless the solve is part of ``ContactProblem.one_step``.
        friction_penalty: ε in tangential direction (stress per length); by default that of the
            gaps. Not used by ``qs.Norton``.
        initial_overclosure: What becomes of penetration at the first pairing, before anything has
            moved. ``"resolve"``: it is a misfit as any other, and the next solve presses the bodies
            apart (an interference fit; :meth:`allow_overclosure` does so gradually). ``"ignore"``:
            it counts as no gap, without strain, for good: each node keeps its depth. ``"error"``:
            it is refused. Points deeper than the search radius are not paired, and not seen. A tie
            leaves any gap as it is; with it the first two are the same.

    Raises:
        ValueError: If a name is unknown, the penalty or the radius is not positive, or the two
            surfaces share facets or differ in dimension or communicator.
        TypeError: If a surface or the law is of another type.

    Warns:
        ContactWarning: If hardly anything is paired, the master is much finer and sampled at nodes,
            or the surfaces penetrate each other deeply.
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface | RigidSurface,
        formulation: str = "quasi-symmetric",
        law: Law | None = None,
        penalty: float | str = "auto",
        search_radius: float | None = None,
        quadrature: str = "nodal",
        quadrature_degree: int | None = None,
        normals: str | None = None,
        enforcement: str = "penalty",
        gap_tolerance: float = 1e-8,
        unknown: str | typing.Sequence[str] = "displacement",
        dt: float | None = None,
        friction: Friction | None = None,
        friction_penalty: float | None = None,
        initial_overclosure: str = "resolve",
    ) -> None:
        law = Unilateral() if law is None else law
        # Without surfaces there is no communicator of ours to agree on the error with.
        comm = next((s.comm for s in (slave, master) if isinstance(s, Surface)), MPI.COMM_WORLD)
        with collective_errors(comm):
            check_surfaces(slave, master)
            check_choice("formulation", formulation, FORMULATIONS)
            if isinstance(master, RigidSurface) and formulation in TWO_PASSES:
                raise ValueError(
                    f"formulation: {formulation} needs a multiplier on both sides, and a rigid "
                    'tool has none; use "master-slave" or "quasi-symmetric"'
                )
            check_choice("quadrature", quadrature, QUADRATURES)
            if normals is None:
                averaging = quadrature == "overlay" or friction is not None
                normals = "bisector" if averaging else "facet"
            check_choice("normals", normals, NORMALS)
            check_choice("enforcement", enforcement, ENFORCEMENTS)
            if not isinstance(law, Law):
                raise TypeError(f"law: must be qs.Tied() or qs.Unilateral(), not {law!r}")
            if not (isinstance(penalty, str) and penalty == "auto"):
                check_positive("penalty", penalty, ' or "auto"')
            if search_radius is not None:
                check_positive("search_radius", search_radius)
            check_positive("gap_tolerance", gap_tolerance)
            check_friction(friction, friction_penalty, law, slave)
            overclosure = Overclosure(initial_overclosure)
            kinematics = Kinematics(unknown, dt, friction is not None and friction.needs_dt)
            degree = check_quadrature(slave, master, quadrature, quadrature_degree)
        check_agreement(
            comm,
            formulation=formulation,
            law=type(law).__name__,
            penalty=penalty,
            search_radius=search_radius,
            quadrature=quadrature,
            quadrature_degree=degree,
            normals=normals,
            enforcement=enforcement,
            gap_tolerance=gap_tolerance,
            unknown=kinematics.unknown,
            dt=dt,
            friction=friction,
            friction_penalty=friction_penalty,
            initial_overclosure=initial_overclosure,
        )
        self.slave = slave
        self.master = master
        self.formulation = formulation
        self.law = law
        self.quadrature = quadrature
        self.quadrature_degree = degree
        self.normals = normals
        self.enforcement = enforcement
        self.gap_tolerance = float(gap_tolerance)
        self._kinematics = kinematics
        self._offset = None
        self.passes = []
        #: Penetration at the first pairing: its ``depth``, and the ``part`` that is let be.
        self.overclosure = overclosure
        self.tangential = None
        if friction is not None:
            self.tangential = Tangential(friction, slave, friction_penalty)
        #: Counts the pairings made so far.
        self.version = 0
        self.watch = Stopwatch()
        self._given_radius = None if search_radius is None else float(search_radius)
        self._automatic = penalty == "auto"
        self._penalty = None if penalty == "auto" else float(penalty)
        #: How ε was chosen.
        self.penalty_source = "automatic, at the first solve" if penalty == "auto" else "given"
        #: Mean K_kk / S_k (stress per length) at the contact nodes of the slave and of a deformable
        #: master, when matrices were last made.
        self.stiffness: tuple[float, ...] = ()
        self._pair()
        advise(self)

    # --- Pairing

    def update(self) -> None:
        """Pair anew, after the meshes of the bodies have been moved. Collective.

        Displacements then count from the moved meshes.

        Raises:
            ValueError: If coordinates are not finite or a facet has no area.
        """
        with self.watch.stage("pairing"):
            update_surfaces(*(s for s in (self.slave, self.master) if isinstance(s, Surface)))
        self._pair()

    def _pair(self) -> None:
        if isinstance(self.master, RigidSurface):
            self.master.check_state()
            self._tool_version = self.master.version
        with self.watch.stage("pairing"):
            with_facets: list[Surface | RigidSurface] = [self.slave]
            if isinstance(self.master, Surface) or not self.master.is_analytic:
                with_facets.append(self.master)
            low, high = zip(*(s.facet_size_range for s in with_facets), strict=True)
            self._touching = TOUCHING * min(low)
            self._facet_size = min(low)
            self._radius = max(high) if self._given_radius is None else self._given_radius
            both = self.formulation == "quasi-symmetric"
            roles: list[tuple[Surface, Surface | RigidSurface]] = [(self.slave, self.master)]
            if self.formulation in TWO_PASSES and isinstance(self.master, Surface):
                roles.append((self.master, self.slave))
            one_sided = self.formulation == "two-half-pass"
            share = 1.0 if one_sided else 1 / len(roles)
            kept = self.multipliers_on_nodes()
            self.passes = []
            for slave, master in roles:
                points = pair(
                    slave,
                    master,
                    self.quadrature,
                    self.quadrature_degree,
                    self.normals,
                    both,
                    self._radius,
                )
                self.passes.append(
                    WeightedGap(
                        slave,
                        master,
                        points,
                        self.law,
                        share,
                        slave_only=one_sided,
                        by_cover=self.quadrature == "overlay",
                        augmented=self.augmented,
                    )
                )
            if self.version == 0:
                self.overclosure.read(self.passes, self._facet_size)
            self.overclosure.apply(self.passes)
            if self.tangential is not None:
                self.tangential.pair(self.passes, self.quadrature == "overlay")
                if self.version > 0:
                    self._continue_step()
            if kept:
                self.set_multipliers_on_nodes(kept)
            self.set_motion()
            self.version += 1

    def allow_overclosure(self, part: float) -> None:
        """Set the part of the initial overclosure that is not resolved, from 0 to 1. Collective.

        Ramped from 1 to 0 over some solves, or in a stepper's ``drive``, it shrinks an interference
        fit on gradually, where bodies are nonlinear or overclosed by much of an element.

        Raises:
            ValueError: If it is not from 0 to 1, the same on all ranks.
        """
        self.overclosure.allow(self.comm, part)
        self.overclosure.apply(self.passes)

    def _continue_step(self) -> None:
        """Let slip count from where the bodies and the tool are now, however they got there.

        Bodies in total displacements keep their unknowns when contact pairs anew, unless whoever
        has moved their mesh sets them to zero; which of the two the next evaluation tells.
        """
        for slip in self.slips:
            slip.starts_there = True
            if isinstance(self.master, RigidSurface) and self.unknown[0] == "displacement":
                slip.start = slip.change(self.master.motion)

    # --- Pairing points

    @property
    def search_radius(self) -> float:
        """Distance (length) beyond which a node is not paired."""
        return self._radius

    @property
    def pairing(self) -> Pairing:
        """Pairing points that were found from nodes this rank owns; those of the first pass."""
        return Pairing.from_cpp(self.passes[0].points)

    @property
    def pairings(self) -> list[Pairing]:
        """Pairing points of every pass: two for double-pass contact, otherwise one."""
        return [Pairing.from_cpp(p.points) for p in self.passes]

    @property
    def num_unpaired(self) -> int:
        """Nodes that were searched and found no partner, over all passes and ranks. Collective."""
        return int(self.comm.allreduce(sum(p.points.num_unpaired for p in self.passes)))

    # --- Friction

    @property
    def friction(self) -> Friction | None:
        """The law of friction, None without."""
        return None if self.tangential is None else self.tangential.friction

    @property
    def symmetric(self) -> bool:
        """Whether what contact adds to the tangent is symmetric."""
        same_scale = isinstance(self.master, RigidSurface) or self.scale[0] == self.scale[1]
        potential = self.friction is None or self.friction.symmetric
        return self.formulation != "two-half-pass" and same_scale and potential

    def end_step(self) -> None:
        """Let slip count from the last evaluation on, and friction from what it is there."""
        if self.tangential is not None:
            self.tangential.end_step()

    # --- Penalty

    @property
    def penalty(self) -> float | None:
        """ε, stress per length; None as long as an automatic one has not been computed."""
        return self._penalty

    @property
    def has_automatic_penalty(self) -> bool:
        """Whether ε is, or is going to be, computed from the stiffness of the bodies."""
        return self._automatic

    def set_penalty(self, penalty: float) -> None:
        """Set ε, stress per length, for the solves to come. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks.
        """
        with collective_errors(self.comm):
            check_positive("penalty", penalty)
        check_agreement(self.comm, penalty=penalty)
        self._penalty = float(penalty)
        self._automatic = False
        self.penalty_source = "given"

    @property
    def needs_penalty(self) -> bool:
        """Whether an automatic penalty is to be computed, for the problem.

        Once: with another ε the gaps of the last step would be wrong ones. But an augmented
        Lagrangian may have any, and that of bodies in velocities follows Δt and how fast they flow.
        """
        flows = self.augmented and "velocity" in self.unknown
        return self._automatic and (self._penalty is None or flows)

    def set_stiffness(
        self, stiffness: tuple[float, ...], modulus: tuple[float, ...], together: bool
    ) -> None:
        """Take over the bodies' stiffness, and an automatic penalty from it; internal."""
        self.stiffness = stiffness
        if self.needs_penalty:
            known = stiffness, modulus, self.quadrature, self.augmented, together
            self.set_automatic_penalty(automatic_penalty(*known), source(*known))

    def set_automatic_penalty(self, penalty: float, source: str) -> None:
        """Set ε, stress per length, from the bodies' stiffness as ``source`` says; internal."""
        self._penalty, self.penalty_source = penalty, source

    # --- Report

    def report(self) -> ContactReport:
        """What the contact is and does, to print as a table. Collective.

        Pairing, gaps and active nodes as at the last evaluation, penalty and what it means for
        linear solvers, nodes that no force reaches. The same on all ranks; it costs about as much
        as a nodal pairing.
        """
        return make_report(self)
