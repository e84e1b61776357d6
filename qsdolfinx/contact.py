"""Contact between two surfaces: formulation, law, penalty, and what there is to read afterwards."""

from __future__ import annotations

import contextlib
import time
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.checks import check_choice, check_positive
from qsdolfinx.collective import check_agreement, collective_errors
from qsdolfinx.gap import WeightedGap, handle_of
from qsdolfinx.kinematics import Kinematics
from qsdolfinx.laws import Law, Unilateral
from qsdolfinx.pairing import Pairing
from qsdolfinx.quadrature import NORMALS, QUADRATURES, check_quadrature, pair
from qsdolfinx.results import TWO_PASSES, ContactResults
from qsdolfinx.rigid_surface import RigidSurface
from qsdolfinx.surface import Surface, update_surfaces

Array = npt.NDArray[np.float64]
T = typing.TypeVar("T")

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")

#: Gaps smaller than this part of the smallest facet count as closed.
TOUCHING = 1e-12


class Contact(ContactResults):
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
        formulation: ``"master-slave"``, ``"double-pass"`` or ``"quasi-symmetric"``. A rigid tool
            carries no multiplier, so that only the first and the last are possible; with an
            analytic shape they are the same.
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
            (the default at nodes); ``"averaged"`` at the nodes of the other, or of the cut,
            surface; ``"bisector"`` of the normals of both (the default on the overlay). Those of an
            analytic shape are always its own, at the point that is closest.
        enforcement: ``"penalty"``, or ``"augmented-lagrangian"``: multipliers are updated until
            they leave no gap larger than the tolerance. They are kept for the next solve, also
            when contact pairs anew; :meth:`reset` forgets them.
        gap_tolerance: That gap in units of the smallest facet.
        unknown: What the unknowns of the bodies are: ``"displacement"`` or ``"velocity"``, (2) and
            (3), or one of them for the slave and the master, such as a forged workpiece and an
            elastic die, ``("velocity", "displacement")``.
        dt: Δt, time, if a body has velocities; :meth:`set_dt` changes it.

    Raises:
        ValueError: If a name is unknown, the penalty or the radius is not positive, or the two
            surfaces share facets or differ in dimension or communicator.
        TypeError: If a surface or the law is of another type.
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
    ) -> None:
        law = Unilateral() if law is None else law
        # Without surfaces there is no communicator of ours to agree on the error with.
        comm = next((s.comm for s in (slave, master) if isinstance(s, Surface)), MPI.COMM_WORLD)
        with collective_errors(comm):
            _check_surfaces(slave, master)
            check_choice("formulation", formulation, FORMULATIONS)
            if isinstance(master, RigidSurface) and formulation in TWO_PASSES:
                raise ValueError(
                    f"formulation: {formulation} needs a multiplier on both sides, and a rigid "
                    'tool has none; use "master-slave" or "quasi-symmetric"'
                )
            check_choice("quadrature", quadrature, QUADRATURES)
            if normals is None:
                normals = "bisector" if quadrature == "overlay" else "facet"
            check_choice("normals", normals, NORMALS)
            check_choice("enforcement", enforcement, ENFORCEMENTS)
            if not isinstance(law, Law):
                raise TypeError(f"law: must be qs.Tied() or qs.Unilateral(), not {law!r}")
            if not (isinstance(penalty, str) and penalty == "auto"):
                check_positive("penalty", penalty, ' or "auto"')
            if search_radius is not None:
                check_positive("search_radius", search_radius)
            check_positive("gap_tolerance", gap_tolerance)
            kinematics = Kinematics(unknown, dt)
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
        self._offset: tuple[PETSc.Vec | None, PETSc.Vec | None] | None = None
        self.passes: list[WeightedGap] = []
        #: Counts the pairings made so far.
        self.version = 0
        #: Wall time (s) that this rank has spent in pairing, gaps and insertion.
        self.seconds = 0.0
        self._given_radius = None if search_radius is None else float(search_radius)
        self._automatic = penalty == "auto"
        self._penalty = None if penalty == "auto" else float(penalty)
        self._pair()

    # --- Pairing

    def update(self) -> None:
        """Pair anew, after the meshes of the bodies have been moved. Collective.

        Displacements then count from the moved meshes.

        Raises:
            ValueError: If coordinates are not finite or a facet has no area.
        """
        update_surfaces(*(s for s in (self.slave, self.master) if isinstance(s, Surface)))
        self._pair()

    def _pair(self) -> None:
        if isinstance(self.master, RigidSurface):
            self.master.check_state()
            self._tool_version = self.master.version
        with self._clock():
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
            if kept:
                self.set_multipliers_on_nodes(kept)
            self._set_motion()
            self.version += 1

    # --- Motion

    @property
    def unknown(self) -> tuple[str, str]:
        """``"displacement"`` or ``"velocity"``, of the slave's and of the master's body."""
        return self._kinematics.unknown

    @property
    def dt(self) -> float | None:
        """Δt, time; None if neither body has velocities."""
        return self._kinematics.dt

    @property
    def scale(self) -> tuple[float, float]:
        """Displacement per unknown of the slave's and the master's body: 1 or Δt."""
        return self._kinematics.scale

    def set_dt(self, dt: float) -> None:
        """Set Δt (time) for the solves to come. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks, or no body has
                velocities.
        """
        with collective_errors(self.comm):
            Kinematics(self.unknown, dt)
        check_agreement(self.comm, dt=dt)
        self._kinematics.dt = dt
        self._set_motion()

    def set_offset(self, slave: fem.Function | None, master: fem.Function | None) -> None:
        """Set displacements (length) beside those of the unknowns: u = scale · x + offset.

        For time stepping: from the meshes as they are, contact then sees the displacements to the
        end of the step, whatever part of the step the meshes have been moved already. Collective.

        Args:
            slave: On the space of the slave's body (the mixed one, if its surface has a sub-space),
                read now; None for no offset.
            master: The same for the master.

        Raises:
            ValueError: If a space is not that of the body.
        """
        self._offset = (
            self._known("slave", self.slave, slave),
            self._known("master", self.master, master),
        )
        self._set_motion()

    def _known(
        self, name: str, surface: Surface | RigidSurface, function: fem.Function | None
    ) -> PETSc.Vec | None:
        """Owned values of a function on a body's space as a vector; None of a rigid tool."""
        vec = surface.create_vec() if isinstance(surface, Surface) else None
        with collective_errors(self.comm):
            if function is not None:
                dofmap = function.function_space.dofmap
                owned = dofmap.index_map.size_local * dofmap.index_map_bs
                if vec is None or len(vec.array_r) != owned:
                    raise ValueError(f"{name}: the offset must be on the space of the body")
                vec.array[:] = function.x.array[:owned]
        return vec

    def _set_motion(self) -> None:
        """Hand scales and offsets to the passes. Collective."""
        for p in self.passes:
            slave, master = self.ordered(p, self.scale)
            p.scale = slave, master
            if self._offset is not None:
                u = self.ordered(p, self._offset)
                p.offset = p.operator.apply(handle_of(u[0]), handle_of(u[1]))

    @contextlib.contextmanager
    def _clock(self) -> typing.Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds += time.perf_counter() - start

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

    # --- Penalty

    @property
    def penalty(self) -> float | None:
        """ε, stress per length; None as long as an automatic one has not been computed."""
        return self._penalty

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

    @property
    def needs_penalty(self) -> bool:
        """Whether an automatic penalty is to be computed, for the problem.

        Once: with another ε the gaps of the last step would be wrong ones. But an augmented
        Lagrangian may have any, and that of bodies in velocities follows Δt and how fast they flow.
        """
        flows = self.augmented and "velocity" in self.unknown
        return self._automatic and (self._penalty is None or flows)

    def set_automatic_penalty(self, penalty: float) -> None:
        """Set ε, stress per length, from the bodies' stiffness; for the problem."""
        self._penalty = penalty

    # --- Evaluation, for the problem; of a rigid tool there is None in the place of what is given

    def move_tool(self) -> None:
        """Take over the motion of a rigid tool. Collective.

        Raises:
            ValueError: If it is not finite or differs between ranks.
            RuntimeError: If the tool has another position than when contact was last paired.
        """
        if not isinstance(self.master, RigidSurface):
            return
        if self._tool_version != self.master.version:
            raise RuntimeError("the tool has been moved for good: call contact.update()")
        self.master.check_state()
        with self._clock():
            for p in self.passes:
                p.shift = p.change(self.master.motion)

    def evaluate(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Compute gaps for the unknowns of the two bodies. Collective."""
        with self._clock():
            for p in self.passes:
                p.evaluate(self.ordered(p, (slave, master)))

    def add_residual(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Add ∂Φ/∂u at the last evaluation to the residuals of the two bodies. Collective."""
        with self._clock():
            for p in self.passes:
                p.add_forces(p.multiplier(self.eps), self.ordered(p, (slave, master)))

    def add_tangent(self, blocks: tuple[PETSc.Mat | None, ...]) -> None:
        """Add ∂²Φ/∂u² at the last evaluation to the blocks (ss, sm, ms, mm); not assembled here."""
        with self._clock():
            for p in self.passes:
                p.add_stiffness(self.slope(p), self.ordered(p, blocks), pattern=False)

    def add_pattern(self, blocks: tuple[PETSc.Mat | None, ...]) -> None:
        """Add zeros wherever :meth:`add_tangent` may ever add anything."""
        for p in self.passes:
            p.add_stiffness(np.zeros(len(p.values)), self.ordered(p, blocks), pattern=True)

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        for p in self.passes:
            vecs = self.ordered(p, (slave, master))
            p.operator.constrain(handle_of(vecs[0]), handle_of(vecs[1]))

    def num_active_local(self) -> int:
        """Closed rows on this rank at the last evaluation."""
        return sum(int(np.count_nonzero(self.slope(p))) for p in self.passes)

    def active_state(self) -> bytes:
        """What the tangent depends on beside ε: which rows of this rank are closed."""
        if self.law.linear:
            return b""
        return b"".join((self.slope(p) > 0).tobytes() for p in self.passes)

    @property
    def eps(self) -> float:
        """The penalty as a number.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        if self._penalty is None:
            raise RuntimeError('penalty="auto" is computed by the first solve, which has not been')
        return self._penalty

    def slope(self, p: WeightedGap) -> Array:
        """∂λ/∂ḡ at the rows of a pass, at the last evaluation."""
        return p.slope(self.eps, self._touching)

    def ordered(self, p: WeightedGap, of_bodies: tuple[T, ...]) -> tuple[T, ...]:
        """Things of the slave's and the master's body in the order of a pass."""
        return of_bodies if p.slave is self.slave else of_bodies[::-1]

    # --- Augmented Lagrangian, for the problem

    @property
    def augmented(self) -> bool:
        """Whether the multiplier is augmented until the gap is closed."""
        return self.enforcement == "augmented-lagrangian"

    def violation(self) -> float:
        """Largest gap (length) at the last evaluation that a multiplier holds. Collective."""
        local = max(p.violation(self.eps) for p in self.passes)
        return float(self.comm.allreduce(local, op=MPI.MAX))

    @property
    def allowed_gap(self) -> float:
        """Gap (length) at which augmentation ends: ``gap_tolerance`` × the smallest facet."""
        return self.gap_tolerance * self._facet_size

    def known_multipliers(self) -> list[Array]:
        """Copies of λ̂, one array for each pass; see :meth:`set_known_multipliers`."""
        return [p.augmented.copy() for p in self.passes]

    def set_known_multipliers(self, multipliers: typing.Sequence[Array]) -> None:
        """Put back what :meth:`known_multipliers` gave."""
        for p, multiplier in zip(self.passes, multipliers, strict=True):
            p.augmented = multiplier.copy()

    def multipliers_on_nodes(self) -> list[Array]:
        """λ̂ at all owned nodes of each pass's slave; they stay the same when contact pairs anew."""
        return [np.asarray(p.on_nodes(p.augmented, 0.0)) for p in self.passes]

    def set_multipliers_on_nodes(self, multipliers: typing.Sequence[Array]) -> None:
        """Put back what :meth:`multipliers_on_nodes` gave."""
        for p, multiplier in zip(self.passes, multipliers, strict=True):
            p.augmented = np.array(multiplier[p.row_node], dtype=np.float64)

    def reset(self) -> None:
        """Forget the multipliers: the next solve starts from λ̂ = 0, not from the last solution."""
        for p in self.passes:
            p.augmented = np.zeros_like(p.augmented)


def _check_surfaces(slave: Surface, master: Surface | RigidSurface) -> None:
    """Refuse surfaces that cannot be in contact."""
    if isinstance(slave, RigidSurface):
        raise TypeError("slave: must be a qsdolfinx.Surface; a rigid tool can be the master only")
    for name, surface in (("slave", slave), ("master", master)):
        if not isinstance(surface, Surface | RigidSurface):
            raise TypeError(f"{name}: must be a qsdolfinx.Surface, not {type(surface).__name__}")
    if slave.gdim != master.gdim:
        raise ValueError("slave and master have different geometric dimensions")
    if MPI.Comm.Compare(slave.comm, master.comm) not in (MPI.IDENT, MPI.CONGRUENT):
        raise ValueError("slave and master: the meshes must be on the same ranks in the same order")
    if isinstance(master, RigidSurface):
        return
    if slave.axisymmetric != master.axisymmetric:
        raise ValueError("slave and master: both or none must be axisymmetric")
    if slave.mesh is master.mesh and np.intersect1d(slave.facets, master.facets).size:
        raise ValueError("slave and master share facets: a facet cannot be in contact with itself")
