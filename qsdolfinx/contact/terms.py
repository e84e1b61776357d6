"""What a contact adds to a problem: gaps, forces, tangent, and multipliers that are augmented."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact.fields import ContactFields
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.laws import Law
from qsdolfinx.gap.weighted_gap import WeightedGap, handle_of
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
T = typing.TypeVar("T")


class ContactAssembly(ContactFields):
    """Evaluation for the problem; of a rigid tool there is None in the place of what is given."""

    law: Law
    enforcement: str
    gap_tolerance: float
    _penalty: float | None
    _touching: float
    #: Whether a gap that is open by rounding alone counts as open; for the problem.
    strict: bool = False
    _facet_size: float
    _tool_version: int
    #: Wall time that this rank has spent in pairing, gaps and insertion.
    watch: Stopwatch

    @property
    def seconds(self) -> float:
        """Wall time (s) that this rank has spent in pairing, gaps and insertion."""
        return sum(self.watch.seconds.values())

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
        with self.watch.stage("gap"):
            for p in self.passes:
                p.shift = p.change(self.master.motion)
            for slip in self.slips:
                slip.shift = slip.change(self.master.motion)

    def evaluate(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Compute gaps for the unknowns of the two bodies. Collective."""
        with self.watch.stage("gap"):
            for p in self.passes:
                p.evaluate(self.ordered(p, (slave, master)))
            for slip in self.slips:
                p = slip.gap
                slip.evaluate(
                    self.ordered(p, (slave, master)),
                    p.multiplier(self.eps)[:, 0],
                    self.slope(p) > 0,
                    self.tangential_penalty,
                    self.dt,
                    self._facet_size,
                    self._in_displacement(p),
                )

    def _in_displacement(self, p: WeightedGap) -> tuple[bool, bool]:
        """Whether the bodies of a pass have displacements; a rigid tool moves as its slave does."""
        kinds = self.unknown[:1] * 2 if isinstance(self.master, RigidSurface) else self.unknown
        slave, master = self.ordered(p, kinds)
        return slave == "displacement", master == "displacement"

    def add_residual(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Add contact's virtual work to the residuals of the two bodies. Collective.

        That is ∂Φ/∂u at the last evaluation, and the work of friction.
        """
        with self.watch.stage("gap"):
            with collective_errors(self.comm):  # a law may be the user's
                multipliers = [p.multiplier(self.eps) for p in self.passes]
            for p, multiplier in zip(self.passes, multipliers, strict=True):
                p.add_forces(multiplier, self.ordered(p, (slave, master)))
            for slip in self.slips:
                slip.add_forces(self.ordered(slip.gap, (slave, master)))

    def add_tangent(self, blocks: tuple[PETSc.Mat | None, ...]) -> None:
        """Add the residual's derivative to the blocks (ss, sm, ms, mm); not assembled here."""
        with self.watch.stage("insertion"):
            for p in self.passes:
                p.add_stiffness(self.slope(p), self.ordered(p, blocks), pattern=False)
            for slip in self.slips:
                slip.add_stiffness(self.slope(slip.gap), self.ordered(slip.gap, blocks))

    def add_pattern(self, blocks: tuple[PETSc.Mat | None, ...]) -> None:
        """Add zeros wherever :meth:`add_tangent` may ever add anything."""
        with self.watch.stage("insertion"):
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
        """Which rows of this rank are closed, and which of them slip."""
        if self.law.linear:
            return b""
        rows = [(self.slope(p) > 0).tobytes() for p in self.passes]
        return b"".join(rows + [slip.state() for slip in self.slips])

    def tangent_state(self) -> bytes:
        """What the tangent of linear bodies depends on beside ε."""
        return self.active_state() + b"".join(slip.tangent_state() for slip in self.slips)

    @property
    def eps(self) -> float:
        """The penalty as a number.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        if self._penalty is None:
            raise RuntimeError('penalty="auto" is computed by the first solve, which has not been')
        return self._penalty

    @property
    def tangential_penalty(self) -> float:
        """ε in tangential direction; only with friction."""
        assert self.tangential is not None
        return self.tangential.penalty(self.eps)

    def slope(self, p: WeightedGap) -> Array:
        """∂λ/∂ḡ at the rows of a pass, at the last evaluation."""
        return p.slope(self.eps, 0.0 if self.strict else self._touching)

    def ordered(self, p: WeightedGap, of_bodies: tuple[T, ...]) -> tuple[T, ...]:
        """Things of the slave's and the master's body in the order of a pass."""
        return of_bodies if p.slave is self.slave else of_bodies[::-1]

    # --- Augmented Lagrangian, for the problem

    @property
    def augmented(self) -> bool:
        """Whether the multiplier is augmented until the gap is closed."""
        return self.enforcement == "augmented-lagrangian"

    def violation(self) -> float:
        """Largest gap or slip (length) that a multiplier ought to have closed. Collective."""
        gaps = [p.violation(self.eps) for p in self.passes]
        local = max(gaps + [slip.violation(self.tangential_penalty) for slip in self.slips])
        return float(self.comm.allreduce(local, op=MPI.MAX))

    @property
    def allowed_gap(self) -> float:
        """Gap (length) at which augmentation ends: ``gap_tolerance`` × the smallest facet."""
        return self.gap_tolerance * self._facet_size

    @property
    def parts(self) -> list[WeightedGap | Slip]:
        """All that has multipliers: gaps of the passes, then their slips."""
        return [*self.passes, *self.slips]

    def known_multipliers(self) -> list[Array]:
        """Copies of λ̂ and τ̂, one array for each part; see :meth:`set_known_multipliers`."""
        return [part.augmented.copy() for part in self.parts]

    def set_known_multipliers(self, multipliers: typing.Sequence[Array]) -> None:
        """Put back what :meth:`known_multipliers` gave."""
        for part, multiplier in zip(self.parts, multipliers, strict=True):
            part.augmented = multiplier.copy()

    def multipliers_on_nodes(self) -> list[Array]:
        """λ̂ and τ̂ at all owned nodes of each part's slave; the same when contact pairs anew."""
        return [
            np.asarray((part.gap if isinstance(part, Slip) else part).on_nodes(part.augmented, 0.0))
            for part in self.parts
        ]

    def set_multipliers_on_nodes(
        self, multipliers: typing.Sequence[Array], turn: bool = True
    ) -> None:
        """Put back what :meth:`multipliers_on_nodes` gave; τ̂ turns with the surface if asked."""
        for part, multiplier in zip(self.parts, multipliers, strict=True):
            at_rows = np.array(multiplier[part.row_node], dtype=np.float64)
            if turn and isinstance(part, Slip):
                at_rows = part.turned(at_rows)
            part.augmented = at_rows

    def reset(self) -> None:
        """Forget the multipliers: the next solve starts from λ̂ = 0 and no friction."""
        for part in self.parts:
            part.augmented = np.zeros_like(part.augmented)
