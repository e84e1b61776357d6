"""Newton's method within the updates of augmented multipliers."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI

from qsdolfinx.contact.contact import Contact
from qsdolfinx.linear.saddle import SaddlePoint
from qsdolfinx.solve.anderson import Augmentation
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.snes import NOT_CLOSED
from qsdolfinx.system.additive import Additive

#: Updates of the multipliers after which a solve with an augmented Lagrangian is given up.
MAX_AUGMENTATIONS = 100

#: Residual after an update of the multipliers, relative to that before, with which the next may be
#: made. With 1e-3 Anderson's combination of earlier updates can fail on the errors.
INNER = 1e-4

#: Times that unknowns and multipliers are solved for together. If the active set changes, Uzawa's
#: method goes on: a primal-dual active set method can cycle at nodes without pressure.
MAX_SADDLE_POINTS = 4

#: Residual, relative to the first one, from which on they may be.
FIRST = 1e-2

#: Residual, relative to the first one, below which rounding errors are.
ROUNDING = 1e-13


class AugmentedNewton(Newton):
    """Finds the multipliers λ̂ that close the gap, too; arguments as of :class:`Newton`."""

    @property
    def num_augmentations(self) -> int:
        """Updates of the multipliers in the last solve."""
        return max(len(self.violation_history) - 1, 0)

    def _first_accuracy(self) -> contextlib.AbstractContextManager[None]:
        """Of the solve before the first update of multipliers."""
        if self._is_loose:
            first = FIRST if self._has_saddle_point else INNER
            return self._accuracy(first, self._final_norm)
        return contextlib.nullcontext()

    def _augment(self) -> None:
        """Update λ̂ and solve again, until the gaps that multipliers hold are closed."""
        contacts = [contact for contact in self.contacts if contact.augmented]
        if not contacts:
            return
        augmentation = Augmentation(contacts)
        final, loose = self._final_norm, self._is_loose
        together = MAX_SADDLE_POINTS if self._has_saddle_point else 0
        counts = self.active_history
        stays = not self.comm.allreduce(counts != counts[:1] * len(counts), op=MPI.LOR)
        while True:
            gaps = [contact.violation() for contact in contacts]
            self.violation_history.append(max(gaps))
            closed = all(g <= c.allowed_gap for g, c in zip(gaps, contacts, strict=True))
            if closed and (self._norms[-1] <= final or not loose):
                return
            if closed and not together:
                loose = False
                with self._accuracy(0.0, final):
                    self._equilibrate()
                continue
            if len(self.violation_history) > MAX_AUGMENTATIONS:
                self._raise_error(NOT_CLOSED)
            if together:
                together -= 1
                if not (stays and self._close(contacts, final) and together):
                    together = 0  # Uzawa's method starts from the solution for its multipliers
                    with self._accuracy(0.0, max(INNER * self._first_norm, final)):
                        self._equilibrate()
                continue
            augmentation.update()
            # What the update adds is to be solved for, however small it is.
            norm = INNER * self._norm(self._evaluate(self._x.array_r))
            norm = norm if loose else min(norm, final)
            with self._accuracy(0.0, max(norm, INNER * final, ROUNDING * self._first_norm)):
                self._equilibrate()

    @property
    def _has_saddle_point(self) -> bool:
        """Whether unknowns and multipliers can be solved for together, see :class:`SaddlePoint`."""
        if not (self._is_loose and isinstance(self._tangent, Additive)):
            return False
        single = all(len(c.passes) == 1 for c in self.contacts if c.augmented)
        return single and all(body.linear for body in self.bodies)

    def _close(self, contacts: typing.Sequence[Contact], final: float) -> bool:
        """Solve for unknowns and multipliers as if the active set stayed.

        Args:
            contacts: Those with an augmented Lagrangian.
            final: Norm of the residual that a solution may have.

        Returns:
            Whether it could be solved for, and the active set has stayed.
        """
        residual = self._evaluate(self._x.array_r)
        self._assemble()
        assert isinstance(self._tangent, Additive)
        if self._tangent.shift is not None:
            return False
        ksp = self.snes.getKSP()
        ksp.setOperators(self._matrix, self._matrix)
        sides = [
            s for s, contact in zip(self.sides, self.contacts, strict=True) if contact.augmented
        ]
        before = [contact.active_state() for contact in contacts]
        with self.watch.stage("solve"):
            ksp.setUp()
            saddle = SaddlePoint(self.bodies, contacts, sides, ksp)
            solved = saddle.solve(residual, final, self._rounding())
        self.num_iterations += 1
        self.num_linear_iterations += saddle.num_iterations
        if solved is None:
            return False
        self._x.array[:] += solved[0]
        for contact, multiplier in zip(contacts, solved[1], strict=True):
            p = contact.passes[0]
            p.augmented = p.law.admissible(multiplier)
        self._monitor(self.snes, 0, self._norm(self._evaluate(self._x.array_r)))
        after = [contact.active_state() for contact in contacts]
        return not self.comm.allreduce(before != after, op=MPI.LOR)

    @property
    def _is_loose(self) -> bool:
        """Whether solves between updates of the multipliers need not be exact."""
        inexact = self._krylov is not None and self._krylov.chooses_tolerance
        augmented = any(contact.augmented for contact in self.contacts)
        return inexact and augmented and not self._slips and not self._drive.tools
