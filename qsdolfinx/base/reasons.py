"""Names of PETSc's converged reasons."""

from __future__ import annotations

#: Reason of SNES if the residual is not finite; PETSc has had two names for it.
NOT_FINITE = -4


def reason_name(reasons: type, value: int) -> str:
    """Name of a PETSc reason; the longest one if there are several."""
    names = [n for n, v in vars(reasons).items() if v == value and n.isupper()]
    return max(names, key=len, default="UNKNOWN")
