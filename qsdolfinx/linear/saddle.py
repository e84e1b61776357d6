"""Unknowns and augmented multipliers from one linear system, while the active set stays."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.contact import active_set, multipliers
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.linear.krylov import SAFETY_LINEAR
from qsdolfinx.linear.presets import GMRES_RESTART
from qsdolfinx.linear.stop import Stop
from qsdolfinx.system.blocks import Side
from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]

#: Mean gap that a solve leaves over the largest one that is allowed.
CLOSED = 0.1

#: Iterations after which a solve is given up, without a restart before.
MAX_ITERATIONS = GMRES_RESTART


class SaddlePoint:
    """Solves [A, Gᵀ W; E W G, 0] [dx; dλ̂] = −[R; W (λ − λ̂)] for bodies that are linear.

    A is the tangent with the penalty's part Gᵀ W E G, E = diag(ε), of the closed rows, R the
    residual with λ, and W the rows' weights. With dλ̂ no gap is left at these rows. Both equations
    are forces, so that one tolerance ends both. Uzawa's method needs a solve with A for each update
    of λ̂, this is one in all: GMRES with the preconditioner [V, ·; 0, −W], V being multigrid's cycle
    for A. The Schur complement −E W G A⁻¹ Gᵀ W tends to −W as ε grows (Benzi & Olshanskii, 2006).

    Args:
        bodies: The bodies.
        contacts: Contacts with an augmented Lagrangian, without friction, of a single pass each.
        sides: Bodies of the slave and the master of each of these contacts.
        ksp: The solver whose matrix is A, with its preconditioner V.
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: typing.Sequence[Side],
        ksp: PETSc.KSP,
    ) -> None:
        self._bodies = bodies
        self._contacts, self._sides = contacts, sides
        self._A, self._V = ksp.getOperators()[0], ksp.getPC()
        self._ends = np.cumsum([body.num_owned for body in bodies])
        self._passes = [contact.gaps[0] for contact in contacts]
        #: Components that have a λ̂, of shape (rows, width).
        self._unknown = [
            active_set.closed(c, p)[:, None] & _components(p)
            for c, p in zip(contacts, self._passes, strict=True)
        ]
        self._closed = [
            active_set.closed(c, p) for c, p in zip(contacts, self._passes, strict=True)
        ]
        widths = [np.ones((1, p.operator.width)) for p in self._passes]
        weights = [p.weight[:, None] * w for p, w in zip(self._passes, widths, strict=True)]
        self._weight = self._at_closed(weights)
        eps = [c.eps * p.relative_penalty for c, p in zip(contacts, self._passes, strict=True)]
        penalties = [e[:, None] * w for e, w in zip(eps, widths, strict=True)]
        self._stiffness = self._weight * self._at_closed(penalties)
        self._x, self._y = self._A.createVecs()
        #: Whether the last solve has converged, its iterations, and the part of b that is left.
        self.converged, self.num_iterations, self.left = False, 0, np.inf
        #: Whether a direct solver would have been faster, of "auto".
        self.crawls = False
        #: Changes of the owned unknowns that it found.
        self.change: Array = np.zeros(0)
        #: λ̂ of each contact that it found, zero at open rows.
        self.multipliers: list[Array] = []

    def solve(
        self,
        residual: Array,
        final: float,
        rounding: float,
        part: float = 0.0,
        longest: int = MAX_ITERATIONS,
    ) -> None:
        """Find ``change`` and ``multipliers``. Once; collective.

        Args:
            residual: R, owned values.
            final: Norm of the residual that a solution may have.
            rounding: Norm of the residual that cannot be got below.
            part: What may be left of both residuals, relative to what they are.
            longest: Iterations after which it is given up.
        """
        comm = self._bodies[0].comm
        square = comm.allreduce(float(self._stiffness @ self._stiffness), op=MPI.SUM)
        allowed = min(multipliers.allowed(contact) for contact in self._contacts)
        tolerance = max(
            min(SAFETY_LINEAR * final, CLOSED * allowed * float(np.sqrt(square))), rounding
        )
        known = self._at_closed([p.state.augmented for p in self._passes])
        image = [c.gaps[0].multiplier(c.eps) for c in self._contacts]
        rows = -self._weight * (self._at_closed(image) - known)

        b = PETSc.Vec().createWithArray(np.concatenate([-residual, rows]), comm=comm)
        y = b.duplicate()
        matrix = PETSc.Mat().createPython([b.getSizes()] * 2, self, comm)
        matrix.setUp()
        ksp = PETSc.KSP().create(comm)
        ksp.setOperators(matrix)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(MAX_ITERATIONS)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setTolerances(rtol=part, atol=tolerance, max_it=min(longest, MAX_ITERATIONS))
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(self)
        Stop(ksp, comm)
        ksp.solve(b, y)
        self.converged = ksp.getConvergedReason() > 0
        self.num_iterations = ksp.getIterationNumber()
        self.left = ksp.getResidualNorm() / (b.norm() or 1.0)
        self.change, rows = (part.copy() for part in np.split(y.array_r, [self._ends[-1]]))
        self.multipliers = self._on_rows(known + rows)
        for thing in (ksp, matrix, b, y, self._x, self._y):
            thing.destroy()
        interrupt.look(comm)

    # --- What PETSc calls

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The product of the matrix."""
        here, rows = np.split(x.array_r, [self._ends[-1]])
        self._x.array[:] = here
        self._A.mult(self._x, self._y)
        forces = self._y.array_r + self._forces(rows)
        y.array[:] = np.concatenate([forces, self._stiffness * self._gaps(here)])

    def apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """The product of the preconditioner."""
        here, rows = np.split(r.array_r, [self._ends[-1]])
        change = -rows / self._weight
        self._x.array[:] = here - self._forces(change)
        self._V.apply(self._x, self._y)
        z.array[:] = np.concatenate([self._y.array_r, change])

    # --- Parts of it

    def _forces(self, values: Array) -> Array:
        """Gᵀ W of multipliers at the closed rows, zero at constrained unknowns. Collective."""
        forces = [body.force for body in self._bodies]
        for force in forces:
            force.zeroEntries()
        parts = zip(self._contacts, self._passes, self._sides, self._on_rows(values), strict=True)
        for contact, p, (s, m), multiplier in parts:
            vecs = forces[s], None if m is None else forces[m]
            p.add_forces(multiplier, contact.ordered(p, vecs))
        for body in self._bodies:
            body.force.array[body.owned_constrained] = 0
        return np.concatenate([force.array_r for force in forces])

    def _gaps(self, values: Array) -> Array:
        """G of owned unknowns, at the closed rows. Collective."""
        parts = np.split(values, self._ends[:-1])
        for body, part in zip(self._bodies, parts, strict=True):
            body.force.array[:] = part
            body.force.array[body.owned_constrained] = 0
        gaps = []
        for contact, p, (s, m) in zip(self._contacts, self._passes, self._sides, strict=True):
            vecs = self._bodies[s].force, None if m is None else self._bodies[m].force
            gaps.append(p.change_of(contact.ordered(p, vecs)))
        return self._at_closed(gaps)

    def _at_closed(self, values: typing.Sequence[Array]) -> Array:
        """Values at the closed rows of all contacts, one after the other."""
        return np.concatenate(
            [v[unknown] for v, unknown in zip(values, self._unknown, strict=True)]
        )

    def _on_rows(self, values: Array) -> list[Array]:
        """The inverse: an array for each contact; components that are no unknowns follow.

        Collective.
        """
        out, start = [], 0
        for p, unknown, closed in zip(self._passes, self._unknown, self._closed, strict=True):
            on_rows = np.zeros_like(p.state.augmented)
            end = start + np.count_nonzero(unknown)
            on_rows[unknown] = values[start:end]
            out.append(on_rows if p.extension is None else p.extension.fill(on_rows, closed))
            start = end
        return out


def _components(p: WeightedGap) -> npt.NDArray[np.bool_]:
    """Components of the multipliers that are unknowns, shape (rows, width)."""
    if p.extension is None:
        return np.ones_like(p.state.augmented, dtype=bool)
    return ~p.extension.held
