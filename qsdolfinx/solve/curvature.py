"""When Newton's method takes the second derivatives of gaps that follow the bodies."""

from __future__ import annotations

import dataclasses
import typing

#: Part of its largest residual in a solve below which second derivatives of gaps count: far from
#: the solution they make the tangent indefinite.
WITH_CURVATURE = 1e-2

#: Part below which they are tried where two iterations in a row have left more than that of their
#: residuals, and iterations until they are tried again where the residual grows with them.
TRY_CURVATURE, SLOW, PATIENCE = 0.1, 0.4, 3


@dataclasses.dataclass
class Curvature:
    """Decides whether the tangent of a run has them.

    Far from the solution pressures are much too large, and they make the tangent indefinite. Where
    bodies are deep in each other Newton's method hardly gets on without them: they are tried then.

    Attributes:
        tried: Whether the last tangent had them though it may have been too early.
        wait: Iterations until they are tried again.
    """

    tried: bool = False
    wait: int = 0

    def counts(self, norms: typing.Sequence[float], largest: float) -> bool:
        """Whether the next tangent has them.

        Args:
            norms: Norm of the residual at each iteration of the run.
            largest: Of those of the solve.
        """
        if not norms or norms[-1] <= WITH_CURVATURE * largest:
            self.tried = False
            return True
        if self.tried and norms[-1] > norms[-2]:
            self.wait = PATIENCE
        elif not self.tried and self.wait > 0:
            self.wait -= 1
        self.tried = self.wait == 0 and (self.tried or _is_slow(norms, largest))
        return self.tried


def _is_slow(norms: typing.Sequence[float], largest: float) -> bool:
    last = norms[-3:]
    near = len(last) == 3 and last[-1] <= TRY_CURVATURE * largest
    return near and last[2] > SLOW * last[1] and last[1] > SLOW * last[0]
