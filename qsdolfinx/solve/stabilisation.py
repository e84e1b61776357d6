"""Vanishing stabilisation for nonlinear bodies that are supported by contact alone."""

from __future__ import annotations

import dataclasses
import warnings

from qsdolfinx.base.checks import POSITIVE, check, either

#: Stiffness of springs that vanish with the residual, over the diagonal of a body's matrix: those
#: that users ask for, and those of bodies that some conditions hold, if these and the active
#: constraints leave a rigid motion free. With this value, rings between plates take fewest
#: iterations; an O-ring takes as many as without springs.
VANISHING = 1e-3


@dataclasses.dataclass(frozen=True)
class Stabilisation:
    """Springs that stabilise unsupported rigid bodies in a solve, without changing its result.

    The Dirichlet conditions of an unsupported body leave a rigid motion, in which active contact
    alone supports it. An example is an O-ring between moving tools. Newton's method may lose such a
    body: an iteration opens all contacts, and the body is then in equilibrium anywhere. Springs
    therefore hold each unknown of such a body at its present value. They are proportional to the
    diagonal of the body's own stiffness. The springs are part of Newton's matrix only, not of the
    residual, and decrease in proportion to the residual (a proximal point method).

    Args:
        stiffness: Stiffness of the springs in the first iteration, in units of the diagonal of the
            body's stiffness, at most that of the softest body. By default 1e-3.
        decrease: Deprecated, without effect: springs vanish with the residual.
        tolerance: Deprecated, without effect, as ``decrease``.
        max_solves: Deprecated, without effect, as ``decrease``.

    Raises:
        ValueError: If the stiffness is not positive.

    Warns:
        DeprecationWarning: If a deprecated argument is given.
    """

    stiffness: float | None = None
    decrease: float | None = None
    tolerance: float | None = None
    max_solves: int | None = None

    def __post_init__(self) -> None:
        check(either(POSITIVE, None), stiffness=self.stiffness)
        given = [
            name
            for name in ("decrease", "tolerance", "max_solves")
            if getattr(self, name) is not None
        ]
        if given:
            warnings.warn(
                f"{', '.join(given)}: no longer has an effect, since springs vanish with the "
                "residual: leave it out",
                DeprecationWarning,
                stacklevel=3,
            )


def vanishing(settings: Stabilisation | None) -> float | None:
    """Stiffness of springs in Newton's matrix; None without stabilisation."""
    return None if settings is None else settings.stiffness or VANISHING
