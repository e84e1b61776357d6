"""Friction of constraints at points: forces follow from slips."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.laws import Limited, Rows
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.following import Changes, Kept, Mixed
from qsdolfinx.gap.own_rows import OfVertices
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.system.friction_rows import Tangential
from qsdolfinx.system.normal_rows import LEAST_PROXIMAL, Normal, Scales

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Slip of a first guess, as a part of a facet, above which it counts as due to the guess. A smaller
#: slip is corrected by the next iteration.
GUESSED = 0.1


class PointFriction:
    """Friction law at points, with multipliers at nodes.

    With τ_h = Σ_k N_k τ_k, the penalty γ_t in tangential direction, and the pressure p_p of the
    point, see ``PointConstraints``,

        y_p = τ_h + ρ_p + γ_t (g_p − (τ_h − τ_0h)/ε_t),   τ_p = T(y_p, p_p),
        (R_τ)_k = Σ_p w_p N_k (τ_p − τ_h)/γ_t,

    T is the friction law: for Coulomb the projection onto the ball of radius μ p_p. ρ_p is τ_p −
    τ_h at the start of the step, with Σ_p w_p N_k ρ_p = 0, so that a step without a load changes
    nothing. Forces are Σ_p w_p τ_p · ∂g_p/∂u. For an augmented Lagrangian 1/ε_t is 0; τ_0h is τ_h
    at the start of the step. With a penalty there are multipliers, too: without them, the direction
    of slip would change in each iteration if the penalty is stiff. Laws that depend on slip alone,
    such as Norton's, need no multipliers. A node has a multiplier for each of its smooth patches,
    with gdim components. Components that conditions constrain on both sides without relative motion
    are 0. At fully constrained nodes, and where points hardly cover a patch, they are the mean of
    the neighbours, like the multipliers of the pressure.

    Args:
        model: The contact.
        slip: Its slip.
    """

    #: Part of the diagonal subtracted in the inexact derivative, as compliance.
    proximal = LEAST_PROXIMAL

    def __init__(self, model: ContactModel, slip: Slip) -> None:
        self.model, self.slip = model, slip
        #: γ_t (stress per length).
        self.gamma: float
        #: γ_t/ε_t for a penalty; 0 for an augmented Lagrangian.
        self.elastic: float
        self.gamma, self.elastic = model.slip_penalty
        #: Whether there are multipliers: not for laws that depend on slip alone.
        self.has_unknowns = isinstance(slip.friction, Limited)
        self.scales = Scales.of(model, np.full(slip.gap.num_rows, self.gamma))
        self._gdim = slip.gap.slave.gdim
        #: Matrix E of each component; None where τ_free is all of τ.
        self.extensions: list[Extension | None] = self._extended() if self.has_unknowns else []
        #: Components that are unknowns, for the smooth patches of owned nodes, (nodes, block,
        #: gdim), or for vertices of a tool, (vertices, 1, gdim).
        self.free: Flags = self._found()

    @property
    def _points(self) -> PointRows:
        """The points; with updated geometry they are others at each evaluation."""
        assert isinstance(self.slip.gap.rows, PointRows)
        return self.slip.gap.rows

    def _extended(self) -> list[Extension | None]:
        """Condensation of constrained and hardly covered components. Collective."""
        held, points = self.slip.held, self._points
        if self.slip.gap.own is not None:
            return [None] * self._gdim
        if not self.model.comm.allreduce(held is not None, op=MPI.LOR):
            return [points.extended(None)] * self._gdim
        none = np.zeros((len(points.covered), self._gdim), dtype=bool)
        components, clamped = (none, none) if held is None else held

        def of_sides(flags: Flags) -> Flags:
            return np.asarray(flags[:, None] & points.covered)

        return [
            points.extended(points.extension(of_sides(components[:, k]), of_sides(clamped[:, k])))
            for k in range(self._gdim)
        ]

    def _found(self) -> Flags:
        own, held = self.slip.gap.own, self.slip.held
        if own is not None:
            free = np.full((own.num_multipliers, 1, self._gdim), self.has_unknowns)
            if self.model.comm.allreduce(held is not None, op=MPI.LOR):
                none = np.zeros((len(self._points.cover), self._gdim))
                flags = none if held is None else held.components.astype(np.float64)
                of_points = [self._points.from_nodes(flags[:, k]) for k in range(self._gdim)]
                free[:, 0] &= own.from_rows(np.column_stack(of_points)) < 1 - SOLVED
            return free
        covered = self._points.covered
        shape = *covered.shape, self._gdim
        if not self.has_unknowns:
            return np.zeros(shape, dtype=bool)
        out: Flags = np.broadcast_to(covered[:, :, None], shape).copy()
        for k, extension in enumerate(self.extensions):
            if extension is not None:
                out[:, :, k] &= ~extension.held
        return out

    def soften(self, part: float) -> None:
        """Use a penalty of this part of γ_t; 1 ends this. As for ``PointConstraints.soften``."""
        self.gamma, self.elastic = self.model.slip_penalty
        if part < 1 and self.has_unknowns:
            self.gamma, self.elastic = part * self.gamma / 2, 0.5

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the unknowns τ of this rank."""
        return int(np.count_nonzero(self.free)), 1

    def of_component(self, k: int, numbers: Indices) -> tuple[Flags, Indices]:
        """Patches of nodes at which component k of τ is an unknown, and its numbers.

        Args:
            k: The component.
            numbers: Numbers of all unknowns τ of this rank.
        """
        of_free = np.zeros(self.free.shape, dtype=np.int64)
        of_free[self.free] = numbers
        free = self.free[:, :, k]
        return free, of_free[:, :, k][free]

    def _spread(self, multiplier: Array) -> Array:
        """τ_free, and 0 where τ is no unknown, in the shape of ``free``."""
        out = np.zeros(self.free.shape)
        out[self.free] = multiplier[:, 0]
        return out

    def on_sides(self, multiplier: Array) -> Array:
        """Multipliers E τ_free at all patches of owned nodes, (nodes, block · gdim). Collective.

        Those of vertices of a tool are shown by means.
        """
        out, points = self._spread(multiplier), self._points
        if self.slip.gap.own is not None:
            sums = points.sums_of_vectors(self.slip.gap.own.at_rows(out[:, 0]))
            cover = np.repeat(points.cover_of_sides, self._gdim, axis=1)
            covered = np.repeat(points.covered, self._gdim, axis=1)
            return np.divide(sums, cover, out=np.zeros_like(sums), where=covered)
        for k, extension in enumerate(self.extensions):
            if extension is not None:
                out[:, :, k] = extension.fill(out[:, :, k])
        return out.reshape(len(out), out.shape[1] * self._gdim)

    def seen(self, multiplier: Array) -> Array:
        """Multiplier τ_h at the points, (points, gdim). Collective."""
        if not self.has_unknowns:
            return np.zeros((self.slip.gap.num_rows, self._gdim))
        if self.slip.gap.own is not None:
            return self.slip.gap.own.at_rows(self._spread(multiplier)[:, 0])
        return self._points.vectors_from_sides(self.on_sides(multiplier))

    def gathered(self, values: Array) -> Array:
        """Eᵀ Nᵀ W applied to values at points, in the shape of τ_free. Collective."""
        if not self.has_unknowns:
            return np.zeros((0, 1))
        own = self.slip.gap.own
        if own is not None:
            sums = self.slip.gap.share * own.sums(values)
            return np.asarray(sums[:, None][self.free][:, None])
        sums = self.slip.gap.share * self._points.sums_of_vectors(values)
        sums = sums.reshape(self.free.shape)
        for k, extension in enumerate(self.extensions):
            if extension is not None:
                sums[:, :, k] = extension.gather(sums[:, :, k])
        return np.asarray(sums[self.free][:, None])

    @property
    def areas(self) -> Array:
        """Area of each component of τ_free, in the shape of τ_free. Collective."""
        return self.gathered(np.ones((self.slip.gap.num_rows, self._gdim)))

    # --- Evaluation

    def first(self) -> Array:
        """First guess of τ, from the last solve. Collective."""
        if not self.has_unknowns:
            return np.zeros((0, 1))
        state = self.slip.state
        known = state.augmented if state.reached is None else state.reached
        if self.slip.gap.own is not None:
            known = self.slip.gap.own.from_rows(self.slip.at_rows(known))
        return np.asarray(known.reshape(self.free.shape)[self.free][:, None])

    def evaluate(
        self,
        multiplier: Array,
        normal: Normal,
        first: bool,
        again: bool,
        opened: Flags | None,
        sticks: bool = False,
    ) -> Tangential:
        """Evaluate friction at the points, for the last evaluation of slip. Collective.

        Args:
            multiplier: τ.
            normal: Pressures at the points.
            first: Whether active points stick, except those that slipped at the start of the step
                and continue to slip.
            again: Whether the step has been solved before, so that τ shows the present slip state.
            opened: Points that count as inactive; ``normal`` takes them into account.
            sticks: Whether all active points stick.
        """
        slip = self.slip
        known = slip.known(self.elastic, self.seen(multiplier))
        told = self._told(known, normal)
        if first:
            slipped = np.any(known, axis=1) & (again | slip.has_slipped)
            unlimited = normal.active & ~slipped & ~self._has_moved(told)
            goes_on = None if again else self._going_on(slipped, normal.active)
            told = told._replace(unlimited=unlimited, goes_on=goes_on)
        if sticks:
            told = told._replace(unlimited=normal.active.copy())
        with collective_errors(self.model.comm):  # a law may be user code
            response = slip.respond(told, not all(self.model.kinematics.in_displacement))
        response = slip.with_bound(response, told)
        return Tangential(multiplier, told, response, normal.active, None, response.traction)

    def _going_on(self, slipped: Flags, active: Flags) -> Flags | None:
        """Points that slipped, (points,), if bodies slide there as a whole; else None. Collective.

        If all of these points stuck at the start, Newton's method would drag the bodies along.
        Where only some points slip, they are others in each step.
        """
        counts = np.array([np.count_nonzero(slipped & active), np.count_nonzero(active)])
        self.model.comm.Allreduce(MPI.IN_PLACE, counts, op=MPI.SUM)
        return slipped if counts[0] >= 0.5 * counts[1] else None

    def _has_moved(self, told: Rows) -> Flags:
        """Points that a guess moves far, and by more than friction can resist, (points,).

        They would stick to their earlier positions. Collective.
        """
        with collective_errors(self.model.comm):
            held = self.slip.respond(told, not all(self.model.kinematics.in_displacement)).traction
        way, held = (np.linalg.norm(values, axis=1) for values in (self.slip.values, held))
        far = way > GUESSED * self.model.paired.facet_size
        return np.asarray(far & (self.gamma * way > held))

    def _told(self, known: Array, normal: Normal) -> Rows:
        """Input of the friction law."""
        slip, state, dt = self.slip, self.slip.state, self.model.kinematics.dt
        assert self.model.friction is not None
        return Rows(
            slip.values,
            known,
            np.maximum(normal.pressure[:, 0], 0.0),
            normal.active,
            np.zeros_like(normal.active),
            np.full(slip.gap.num_rows, self.gamma),
            slip.projector,
            slip.cover,
            dt,
            self.model.friction.slow(dt, self.model.paired.facet_size),
            slip.parameters,
            state.share,
            np.where(slip.is_fresh, 0.0, state.pressed),
            memory=state.memory.known,
        )

    def residual(self, at: Tangential) -> Array:
        """Residual R_τ. Collective."""
        change = at.traction - self.seen(at.multiplier)
        return np.asarray(self.gathered(change) / self.gamma)

    def in_forces(self) -> Array:
        """Factors γ_t from residual to forces, (unknowns,)."""
        return np.full(self.shape[0], self.gamma)

    def stress(self, at: Tangential, forces: Array) -> Array:
        """Mean stress, or that of mean slips in the stiffest body, beyond rounding. Collective."""
        factor = max(self.scales.largest() / self.gamma, 1.0)
        rounding = float(np.max(self.slip.rounding(at.response), initial=0.0))
        return np.asarray(np.maximum(factor * np.abs(forces) / self.areas - rounding, 0.0))

    def keep(self, at: Tangential) -> None:
        """Store τ in the slip. Collective."""
        state = self.slip.state
        if self.has_unknowns:
            some = self.model.comm.allreduce(bool(at.active.any()), op=MPI.LOR)
            known = at.multiplier if some else 0.0 * at.multiplier
            found, own = self.on_sides(known), self.slip.gap.own
            if own is not None:
                state.of_vertices = OfVertices(found, own.vertex, self._spread(known)[:, 0])
            if self.model.augmented:
                state.augmented = found
            else:
                state.reached = found
        if self.slip.friction.needs_dt:
            state.solved = at.traction

    # --- Derivative

    def by_slip(self, at: Tangential) -> Array:
        """Derivative ∂τ/∂g (stress per length), (points, gdim, gdim)."""
        return np.asarray(at.response.stiffness @ self.slip.projector)

    def by_pressure(self, at: Tangential) -> Array:
        """Derivative ∂τ/∂p where the pressure is positive, (points, gdim)."""
        return np.asarray((at.told.pressure > 0)[:, None] * at.response.coupling)

    def rest(self, at: Tangential) -> Array:
        """Vectors r_p of the terms Σ_p w_p N_k r_p of R_τ, (points, gdim). Collective."""
        return np.asarray((at.traction - self.seen(at.multiplier)) / self.gamma)

    def fields(self, at: Tangential) -> list[Array | None]:
        """Components of τ at the smooth patches of nodes, (nodes, block). Collective."""
        if not self.has_unknowns:
            return [None] * self._gdim
        of_sides = self.on_sides(at.multiplier)
        of_sides = of_sides.reshape(len(of_sides), self.slip.slave.block, self._gdim)
        return [np.ascontiguousarray(of_sides[:, :, k]) for k in range(self._gdim)]

    def turning(self, at: Tangential) -> Array | None:
        """Part of r_p that stays in the plane of a facet, (points, gdim); None if no unknowns."""
        return np.asarray(at.traction / self.gamma) if self.has_unknowns else None

    def mixed(self, at: Tangential) -> list[Mixed] | None:
        """Change of each component of R_τ with the facets; None if constant. Collective.

        Args:
            at: The points, at the last evaluation.
        """
        gap, turning = self.slip.gap, self.turning(at)
        if turning is None or gap.following is None:
            return None
        rest = self.rest(at)
        found = [gap.mixed(rest[:, k], (turning, k)) for k in range(self._gdim)]
        return None if None in found else [one for one in found if one is not None]

    def leaning(self, at: Tangential) -> Array | None:
        """Components of vectors in slips along normals, (points,), see ``Slip.leaning``."""
        return self.slip.leaning(self.elastic, self.seen(at.multiplier), self.gamma)

    def kept(self) -> Kept | None:
        """Part of the trials that turns with the facets; None if there is none. Collective."""
        return self.slip.kept(self.elastic) if self.has_unknowns else None

    def moving_slip(self, at: Tangential) -> Changes:
        """Changes of the slip in the trial, and of τ_h in the planes of facets. Collective."""
        return self.slip.moving(self.elastic, self.seen(at.multiplier), self.gamma)

    def softened(self) -> Array:
        """Diagonal terms that make the inexact derivative regular, (unknowns,)."""
        return np.asarray((-self.proximal / self.gamma * self.areas).ravel())

    def rounded_forces(self, at: Tangential) -> Array:
        """Errors of forces due to rounding of slips, (points,), for laws that depend on slip rates.

        If there are unknowns τ, this rounding is in R_τ instead, and the array is empty.
        """
        if self.has_unknowns:
            return np.zeros(0)
        return np.asarray(self.slip.gap.weight * self.slip.rounding(at.response))

    def rounding(self) -> float:
        """Largest factor from slips to stress on this rank."""
        return self.scales.largest()
