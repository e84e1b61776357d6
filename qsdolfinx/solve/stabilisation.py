"""Stabilisation that vanishes, for nonlinear bodies which only contact holds."""

from __future__ import annotations

import dataclasses
import warnings

from qsdolfinx.base.checks import POSITIVE, check, either

#: Stiffness of springs that vanish with the residual: rings between plates take fewest iterations
#: with it, an O-ring as many as without.
VANISHING = 1e-3


@dataclasses.dataclass(frozen=True)
class Stabilisation:
    """Springs that hold free bodies during a solve, and have no part in its result.

    Conditions leave a free body some rigid motion, such as an O-ring between moving tools: nothing
    but closed contacts holds it there. Newton's method may lose it: a step opens all contacts, and
    what is left is in equilibrium anywhere. So springs hold each unknown of such a body where it
    is, in proportion to the diagonal of the body's own stiffness. They are in Newton's matrix
    alone, and as much weaker as the residual has fallen (a proximal point method).

    Args:
        stiffness: Of the first springs, in units of the diagonal of the body's stiffness, at most
            that of the softest body. By default 1e-3.
        decrease: Deprecated, without effect: springs vanish with the residual.
        tolerance: Likewise.
        max_solves: Likewise.

    Raises:
        ValueError: If the stiffness is not positive.

    Warns:
        DeprecationWarning: If one of the others is given.
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
                f"{', '.join(given)}: has no effect any more, springs vanish with the residual: "
                "leave it out",
                DeprecationWarning,
                stacklevel=3,
            )


def vanishing(settings: Stabilisation | None) -> float | None:
    """Stiffness of springs in Newton's matrix; None without."""
    return None if settings is None else settings.stiffness or VANISHING
