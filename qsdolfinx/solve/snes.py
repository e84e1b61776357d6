"""PETSc's SNES for contact problems: options, checks, and errors when it fails."""

from __future__ import annotations

import typing

from petsc4py import PETSc

from qsdolfinx.base.reasons import NOT_FINITE as FNORM_NAN
from qsdolfinx.base.reasons import reason_name

#: Defaults of the nonlinear solver. With full steps, Newton's method is an active-set method, which
#: ends within a few steps if the bodies are linear; the residual may grow by orders of magnitude
#: when constraints become active. "snes_rtol" is in units of each body's contact forces and
#: reactions.
SNES_OPTIONS: dict[str, typing.Any] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    "snes_divergence_tolerance": 1e300,
    "snes_rtol": 1e-9,
    "snes_max_it": 50,
}

#: PETSc's error code of a type that it does not know.
UNKNOWN_TYPE = 86

#: Options that set a type, and the types known to petsc4py.
_TYPES: dict[str, type] = {
    "ksp_type": PETSc.KSP.Type,
    "pc_type": PETSc.PC.Type,
    "snes_type": PETSc.SNES.Type,
}

#: Types that solve for bodies and multipliers, and types that need one of them as their nonlinear
#: preconditioner.
_KINDS = PETSc.SNES.Type
ALONE = (_KINDS.NEWTONLS, _KINDS.NEWTONTR, _KINDS.KSPONLY, _KINDS.PYTHON)
WITH_NEWTON = (_KINDS.NGMRES, _KINDS.ANDERSON, _KINDS.NRICHARDSON, _KINDS.QN)

#: Reason, in addition to PETSc's, of a solve with an augmented Lagrangian that does not close the
#: gap.
NOT_CLOSED = -1000

#: The same for a force-controlled rigid tool without a displacement in equilibrium.
NOT_BALANCED = -1001

#: The same for a solve in which a body supported by contact alone has lost contact.
LOST = -1002

#: The same for an error that the user raises with a text.
OF_USER = -1003

#: The same for a solve that is ended before its largest number of iterations.
NO_PROGRESS = -1004

#: The same for a user's law that returns numbers that are not finite.
LAW_NOT_FINITE = -1005

_NAMES = {
    NOT_CLOSED: "GAP_NOT_CLOSED",
    NOT_BALANCED: "FORCE_NOT_BALANCED",
    LOST: "BODY_LOST",
    OF_USER: "RAISED_BY_USER",
    NO_PROGRESS: "NO_PROGRESS",
    LAW_NOT_FINITE: "LAW_NOT_FINITE",
}


#: Remedies by reason.
REMEDIES = {
    "DIVERGED_LINEAR_SOLVE": 'conditions may be missing; or take linear_solver="direct"',
    "GAP_NOT_CLOSED": 'take a larger gap_tolerance, penalty="auto", or the other side as the slave',
    "LAW_NOT_FINITE": (
        "a law must return finite numbers for all gaps; if it grows too fast for the gaps of an "
        "iterate, continue it as a straight line, or take smaller steps"
    ),
    "FORCE_NOT_BALANCED": "a tool may pull, or a body may not resist its force",
}

#: Remedies for a residual that is not finite at the start of a solve, or becomes so.
NOT_FINITE = (
    "F is not finite at the start of the solve: look at its coefficients, the values of bcs, and u"
)
NO_LONGER_FINITE = (
    "F was finite at the start of the solve, and is not finite after an iteration, perhaps since a "
    "cell turned inside out: the step is too large; take smaller steps, as qs.TimeStepper does"
)

#: Remedies for all other failures; and for linear bodies in small sliding without friction, where
#: the step size hardly matters.
REMEDY = (
    "nothing may balance the load, or the step may be too large: take smaller steps, as with "
    "qs.TimeStepper"
)
#: Remedies for steps that cannot be cut back any further: for scenes with facets or vertices on
#: both sides, for all scenes, for bodies on both sides, and for finite sliding.
ROUND, REFINE = "round sharp corners that slide by two facets", "refine coarse or rough facets"
SWAP = "swap slave and master"
SMALL = 'take sliding="small" and steps smaller than a facet'
#: What also ends steps: there is no equilibrium nearby.
UNSTABLE = (
    "else nothing may balance the load, or a structure may snap through, or a soft surface that "
    "sticks may fold: drive it by displacements, or give F damping or inertia"
)
REMEDY_LINEAR = "nothing may balance the load: look at loads, conditions and active contacts"

PAGE = "docs/howto/convergence.md"


class ConvergenceError(RuntimeError):
    """The nonlinear solver did not converge; the unknowns are as before the solve.

    The message has one line each for the reason, possible remedies, and a page of the
    documentation. The attributes contain the histories of the solve.

    ``raise qs.ConvergenceError("the temperature rises by more than 50 K")`` in a function that
    :class:`qs.TimeStepper` calls, or in the callback of a solver, asks for a smaller step.

    Args:
        reason: PETSc's SNESConvergedReason, negative; or the whole message, of an error that is not
            the solver's.
        residual_history: Norm of the residual at each iteration.
        active_history: Number of active constraints at each iteration, one list entry per contact.
        linear_reason: PETSc's KSPConvergedReason of the last linear solve.
        violation_history: Largest gap (length) that the multipliers of an augmented Lagrangian have
            left, if any.
        linear: Whether the step size hardly matters.
        why: Reason in words, such as the contact whose active set does not settle.

    Attributes:
        reason: PETSc's SNESConvergedReason, negative.
        reason_name: Name of the reason, such as ``"DIVERGED_MAX_IT"``; ``"RAISED_BY_USER"`` for an
            error with a message of its own.
        residual_history: As the argument.
        active_history: As the argument.
        violation_history: As the argument.
        why: As the argument.
    """

    def __init__(
        self,
        reason: int | str,
        residual_history: typing.Sequence[float] = (),
        active_history: typing.Sequence[list[int]] = (),
        linear_reason: int = 0,
        violation_history: typing.Sequence[float] = (),
        linear: bool = False,
        why: str = "",
    ) -> None:
        self.reason = OF_USER if isinstance(reason, str) else reason
        self.violation_history = list(violation_history)
        names = PETSc.SNES.ConvergedReason
        self.reason_name = _NAMES.get(self.reason) or reason_name(names, self.reason)
        self.residual_history = list(residual_history)
        self.active_history = list(active_history)
        self._text = reason if isinstance(reason, str) else None
        of_linear_solver = ""
        if linear_reason < 0:
            name = reason_name(PETSc.KSP.ConvergedReason, linear_reason)
            of_linear_solver = f", linear solver: {name} ({linear_reason})"
        self._reason = f"SNES did not converge: {self.reason_name} ({reason}){of_linear_solver}"
        self.why = why
        self._reason += self._course() + (f": {why}" if why else "")
        self._remedies = [] if self._text is not None else [self._remedy(linear)]
        super().__init__(self._message())

    def _remedy(self, linear: bool) -> str:
        """Remedies by reason.

        Args:
            linear: Whether the step size hardly matters.
        """
        if self.reason == FNORM_NAN:
            return NO_LONGER_FINITE if self.residual_history else NOT_FINITE
        return REMEDIES.get(self.reason_name, REMEDY_LINEAR if linear else REMEDY)

    def _course(self) -> str:
        """Summary of the iteration, in a few numbers."""
        residuals, out = self.residual_history, ""
        if residuals:
            out = f", {len(residuals) - 1} iterations, residual from {residuals[0]:.3g}"
            out += f" to {residuals[-1]:.3g} (least {min(residuals):.3g})"
        if self.active_history:
            rows = "/".join(map(str, self.active_history[-1]))
            out += f", {rows} active constraints"
        if self.violation_history:
            out += f", largest gap {self.violation_history[-1]:.3g}"
        return out

    def _message(self) -> str:
        remedies = f"\n  may help: {'; '.join(self._remedies)}" if self._remedies else ""
        if self._text is not None:
            return self._text + remedies
        page = f"{PAGE}; error.residual_history, error.active_history"
        return f"{self._reason}{remedies}\n  see {page}"

    def advise(self, text: str) -> None:
        """Insert a text as the first remedy of the message."""
        self._remedies.insert(0, text)
        self.args = (self._message(),)


def in_smallest_step(error: Exception, shapes: bool, tools: bool, finite: bool) -> str:
    """Message of an error at the smallest step, where smaller steps are no remedy.

    Args:
        error: The error.
        shapes: Whether all masters are tools with a shape in closed form.
        tools: Whether all masters are tools.
        finite: Whether there is finite sliding.
    """
    ways = ((not shapes, ROUND), (True, REFINE), (not tools, SWAP), (finite, SMALL))
    these = ", or ".join(text for applies, text in ways if applies)
    remedy = f"if the active set keeps changing, {these}; {UNSTABLE}"
    return str(error).replace(REMEDY, remedy).replace(NO_LONGER_FINITE, remedy)


def forget_failure(snes: PETSc.SNES) -> None:
    """Reset a direct solver whose factorisation failed. Collective.

    Otherwise PETSc's interface to MUMPS rejects all matrices after the failed one, even if the only
    cause was memory that the analysis of the first matrix did not predict.
    """
    ksp = snes.getKSP()
    failed = ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED
    if failed and ksp.getPC().getType() in (PETSc.PC.Type.LU, PETSc.PC.Type.CHOLESKY):
        ksp.getPC().reset()


#: Options that set_options has put into PETSc's database, by prefix.
_put: dict[str, dict[str, str]] = {}


def set_options(
    prefix: str, given: dict[str, typing.Any], linear: dict[str, typing.Any]
) -> frozenset[str]:
    """Put a problem's options into PETSc's database.

    The options stay there, because preconditioners read some options late. Options of an earlier
    problem with this prefix must be removed first. Options of the command line take precedence over
    defaults.

    Args:
        prefix: Prefix of the options.
        given: Options of the user.
        linear: Defaults of the linear solver.

    Returns:
        Names of the options that are defaults of the library, not the user's choice.
    """
    database = PETSc.Options(prefix)
    defaults = SNES_OPTIONS | linear
    put = {key: value for key, value in defaults.items() if not database.hasName(key)} | given
    for key, value in put.items():
        database.setValue(key, value)
    _put[prefix] = {key: database.getString(key, "") for key in put}
    return frozenset(put) - frozenset(given)


def read_options(snes: PETSc.SNES) -> None:
    """Let PETSc read the options of the prefix. Collective.

    Raises:
        ValueError: If an option sets a type that PETSc does not know.
    """
    try:
        snes.setFromOptions()
        if snes.getKSP().getType() is None:  # this type of SNES has no linear solves itself
            snes.getKSP().setFromOptions()
    except PETSc.Error as error:
        database = PETSc.Options(snes.getOptionsPrefix()).getAll()
        types = {name: value for name, value in database.items() if name.endswith("_type")}
        if error.ierr != UNKNOWN_TYPE or not types:
            raise
        known = {name: vars(_TYPES[name]).values() for name in types if name in _TYPES}
        wrong = [name for name, values in known.items() if types[name] not in values]
        wrong = wrong or [name for name in types if name not in known] or list(types)
        text = " or ".join(f"{name}={types[name]!r}" for name in wrong)
        raise ValueError(f"petsc_options: PETSc has no {text}") from error


def check_type(snes: PETSc.SNES, has_factors: bool) -> None:
    """Raise an error for types that cannot solve for bodies and multipliers together.

    Args:
        snes: The solver, with its options set.
        has_factors: Whether linear solves use LU factors; other solvers have no transpose.

    Raises:
        ValueError: If the solver, or its nonlinear preconditioner, is of such a type.
    """
    kind, remedy = snes.getType(), ""
    if kind in WITH_NEWTON:
        if not snes.hasNPC():
            remedy = "add npc_snes_type='newtonls', which it can accelerate but not replace"
        elif snes.getNPC().getType() not in ALONE:
            kind, remedy = snes.getNPC().getType(), "take npc_snes_type='newtonls'"
    elif kind not in ALONE:
        others = ", ".join(map(repr, WITH_NEWTON))
        remedy = f"take 'newtonls', or one of {others} with npc_snes_type='newtonls'"
    elif kind == PETSc.SNES.Type.NEWTONTR and not has_factors:
        remedy = (
            "it needs linear_solver='direct'; or take 'newtonls' with snes_linesearch_type='bt'"
        )
    if remedy:
        raise ValueError(
            f"petsc_options: snes_type={kind!r} does not solve for displacements and multipliers: "
            f"{remedy}"
        )


def remove_options(prefix: str) -> None:
    """Remove options of set_options from PETSc's database, unless they were changed since."""
    database = PETSc.Options(prefix)
    for key, value in _put.pop(prefix, {}).items():
        if database.getString(key, "") == value:
            database.delValue(key)
