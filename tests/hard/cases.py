"""Define a hard case, the variants of contact that solve it, and how it is run."""

import contextlib
import dataclasses
import gc
import itertools
import typing
from unittest import mock

from petsc4py import PETSc

from hard import bodies

import qsdolfinx as qs
from qsdolfinx.linear import presets


@contextlib.contextmanager
def iterative():
    """Use multigrid for displacements, and Schur complements for flow, for problems of any size."""
    always = dict.fromkeys(presets.LARGE, 0)
    of_flow = dict.fromkeys(presets.LARGE_FLOW, 0)
    with mock.patch.multiple(presets, LARGE=always, LARGE_FLOW=of_flow):
        yield


class Variant(typing.NamedTuple):
    """Variant of contact for a case."""

    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"

    def __str__(self):
        return ", ".join(self)

    @property
    def options(self):
        return self._asdict()

    @property
    def augmented(self):
        return self.enforcement != "penalty"

    @property
    def exact_gaps(self):
        """Options that make the gap left by the tolerance negligible."""
        return {"gap_tolerance": 1e-11} if self.augmented else {}


#: Without double-pass contact with an augmented Lagrangian, which cannot close every gap and is
#: refused.
VARIANTS = [
    Variant(*v)
    for v in itertools.product(
        ("quasi-symmetric", "master-slave", "double-pass"),
        ("overlay", "nodal"),
        ("penalty", "augmented-lagrangian"),
    )
    if v[0] != "double-pass" or v[2] == "penalty"
]

#: Variants that run for most cases after each change.
SHORT = (
    Variant(),
    Variant(quadrature="nodal"),
    Variant(enforcement="augmented-lagrangian"),
)


@dataclasses.dataclass
class Case:
    """One line of the table, with one variant.

    Attributes:
        name: Number and name of the group, such as ``"1 stiffness"``.
        label: Description of the case.
        what: Name of the error or invariant.
        allowed: Largest allowed value.
        run: Function that runs the case and returns the error.
        short: Whether the case runs after each change.
        most: Largest allowed number of Newton iterations of a solve.
        refusal: Part of the expected error message, if the case must be refused.
        known: Reason for a known wrong result, or for a known refusal.
    """

    name: str
    label: str
    what: str
    allowed: float
    run: typing.Callable[[], float]
    short: bool = False
    most: int = 1000
    refusal: str = ""
    known: str = ""


@dataclasses.dataclass
class Result:
    """Result of a case.

    Attributes:
        status: ``"right"``; ``"refused"``: an error was raised and the state is unchanged; or
            ``"wrong"``: the error is larger than allowed.
        error: Error that the case returns; None if it was refused.
        iterations: Largest number of Newton iterations of a solve.
        message: Message of the error that was raised.
    """

    case: Case
    variant: Variant
    status: str
    error: float | None
    iterations: int
    message: str

    @property
    def expected(self):
        """Whether the result is as expected."""
        return self.status == ("refused" if self.case.refusal else "right")

    def __str__(self):
        error = "" if self.error is None else f"{self.error:.1e}"
        case = f"{self.case.name}: {self.case.label}"
        found = f"{self.status:8}{self.iterations:>5} {error:>8} {self.case.what}"
        return f"{case:58} {self.variant!s:48} {found} {self.message[:90]}"


def run(case, variant):
    """Run a case and return its result; errors that qsdolfinx raises are part of the result."""
    bodies.iterations.clear()
    error, message = None, ""
    try:
        error = case.run()
        status = "wrong" if case.refusal or not error <= case.allowed else "right"
        if case.refusal:
            message = "should have been refused"
    except (qs.ConvergenceError, qs.StepError, ValueError, RuntimeError) as raised:
        message = str(raised)
        status = "refused" if case.refusal in message else "wrong"
    except (bodies.Wrong, AssertionError) as raised:
        status, message = "wrong", str(raised)
    most = max(bodies.iterations, default=0)
    if status == "right" and most > case.most:
        status, message = "wrong", f"more than {case.most} Newton iterations"
    gc.collect()
    PETSc.garbage_cleanup()
    return Result(case, variant, status, error, most, message)
