"""Updates of augmented multipliers around equilibrium, until the gaps are closed."""

from __future__ import annotations

import contextlib
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact import multipliers
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.solve.anderson import Augmentation
from qsdolfinx.solve.equilibrium import Equilibrium
from qsdolfinx.solve.snes import NOT_CLOSED

Array = npt.NDArray[np.float64]

#: Updates of the multipliers after which a solve with an augmented Lagrangian is given up.
MAX_AUGMENTATIONS = 100

#: Updates after which it is looked at how fast gaps close, and what ε is multiplied with if as many
#: again would not close them. Softer ones need fewer factors and more updates.
PATIENCE, RAISE = 5, 10.0

#: Updates that are still needed at that rate, from which on a direct solver takes over from
#: multigrid, which bears no stiffer ε.
MANY = 20.0

#: Residual after an update of the multipliers, relative to that before, with which the next may be
#: made. With 1e-3 Anderson's combination of earlier updates can fail on the errors. With friction
#: more can be left: nodes that come to slip or stick do away with earlier updates.
INNER, INNER_WITH_FRICTION = 1e-4, 1e-2

#: Gap over the one that a much stiffer body asks for which is told of.
WARN = 10.0


class AugmentedLagrangian:
    """Finds the multipliers λ̂ that close the gaps.

    Args:
        equilibrium: Of the bodies, for given multipliers.
    """

    def __init__(self, equilibrium: Equilibrium) -> None:
        self._equilibrium = equilibrium
        self._newton = equilibrium.newton
        self._system = equilibrium.newton.system
        self._contacts = [c for c in self._system.contacts if c.augmented]
        self._since = 0
        linear = self._newton.linear
        slips = bool(self._system.slips)
        #: Whether Newton's method takes several iterations for each update.
        several = slips or any(contact.follows for contact in self._contacts)
        exact = linear.schur is not None  # Newton's steps with others leave far less than asked for
        self._inner = INNER_WITH_FRICTION if several and not exact else INNER
        #: Whether solves between updates of the multipliers need not be exact: where that saves
        #: iterations, of Newton's method with friction, of a Krylov solver.
        self._is_loose = bool(
            (linear.chooses_tolerance or (several and linear.is_direct))
            and self._contacts
            and not equilibrium.balance.tools
        )

    def first_accuracy(self) -> contextlib.AbstractContextManager[None]:
        """Of the solve before the first update of multipliers: of viscosities an exact one."""
        if self._is_loose and self._newton.linear.schur is None:
            return self._newton.accuracy(of_first=self._inner)
        return contextlib.nullcontext()

    def close_gaps(self) -> None:
        """Update λ̂ and solve again, until the gaps that multipliers hold are closed. Collective.

        Raises:
            ConvergenceError: If a solve fails, or too many updates leave gaps.
        """
        if not self._contacts:
            return
        newton, contacts = self._newton, self._contacts
        augmentation = Augmentation(contacts)
        loose = self._is_loose
        self._since = 0
        while True:
            gaps = [multipliers.violation(contact) for contact in contacts]
            newton.record.violations.append(max(gaps))
            limits = [multipliers.allowed(contact) for contact in contacts]
            closed = all(g <= limit for g, limit in zip(gaps, limits, strict=True))
            if closed and (not loose or self._is_balanced()):
                return
            if closed:
                loose = False
                self._equilibrium.find()
                continue
            if len(newton.record.violations) > MAX_AUGMENTATIONS:
                enough = [multipliers.allowed(contact, False) for contact in contacts]
                if not all(g <= limit for g, limit in zip(gaps, enough, strict=True)):
                    newton.fail(NOT_CLOSED)
                if loose:
                    self._equilibrium.find()
                self._warn_of_stiffer(gaps, limits)
                return
            augmentation.update()
            self._measure_anew()
            if self._raise_penalties(gaps, limits):
                augmentation = Augmentation(contacts)
            self._solve_again(loose)

    def _measure_anew(self) -> None:
        """Let gaps that follow the bodies take their areas from where these are now. Collective."""
        for contact in self._contacts:
            for gap in contact.gaps:
                gap.measure_now()

    def _raise_penalties(
        self, gaps: typing.Sequence[float], limits: typing.Sequence[float]
    ) -> bool:
        """Raise ε of what is not closed and closes slowly, if linear solvers bear it. Collective.

        The result does not depend on ε, but how many updates it takes does: many for soft ones,
        finer slaves and friction. What multigrid does not bear, a direct solver may.

        Returns:
            Whether an ε is another one now.
        """
        seen, linear = self._newton.record.violations, self._newton.linear
        if len(seen) - self._since <= PATIENCE:
            return False
        self._since = len(seen)
        limit = min(limits)
        if seen[-1] <= limit:
            return False
        if seen[-1 - PATIENCE] <= 0:
            return False
        factor = np.log(seen[-1] / seen[-1 - PATIENCE]) / PATIENCE
        left = np.log(limit / seen[-1]) / factor if factor < 0 else np.inf
        if left <= PATIENCE:
            return False
        of_contacts = zip(self._contacts, gaps, limits, strict=True)
        slow = [contact for contact, gap, allowed in of_contacts if gap > allowed]
        soft = [c for c in slow if self._bears(c, not linear.is_direct)]
        if not soft and left > MANY and any(self._bears(c, False) for c in slow):
            self._newton.hand_over("gaps close slowly")
            soft = [c for c in slow if self._bears(c, not linear.is_direct)]
        for contact in soft:
            contact.penalty.stiffen(RAISE)
        return bool(soft)

    @staticmethod
    def _bears(contact: ContactModel, multigrid: bool) -> bool:
        """Whether the ε of a contact may be raised."""
        return contact.penalty.bears(RAISE, contact.friction is not None, multigrid)

    def _warn_of_stiffer(
        self, gaps: typing.Sequence[float], limits: typing.Sequence[float]
    ) -> None:
        """Say which contacts may have wrong forces though their gaps are closed."""
        for contact, gap, limit in zip(self._contacts, gaps, limits, strict=True):
            if gap > WARN * limit:
                warn(
                    "bcs: Dirichlet conditions hold nodes of the softer body where it is tied or "
                    f"sticks to a much stiffer one; a gap of {gap:.1e} is left there, which would "
                    f"have to be less than {limit:.1e} for exact forces along the surface; give "
                    "the stiffer body the same conditions, or leave these nodes out of the contact "
                    "surface",
                    ContactWarning,
                )

    def _is_balanced(self) -> bool:
        """Whether the residual is small enough for a solution. Collective."""
        measures, limits = self._newton.measure()
        return bool(np.all(measures.residuals <= limits))

    def _solve_again(self, loose: bool) -> None:
        """Solve after an update; what it adds is to be solved for, however small it is."""
        system = self._system
        fall = self._inner if loose else INNER
        norm = fall * system.norm(system.residual(system.x.array_r)) if loose else 0.0
        with self._newton.accuracy(loose=norm, fall=fall):
            self._equilibrium.find()
