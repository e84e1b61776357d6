"""Anderson mixing: correct steps of an inexact Newton method from the history of the residual."""

from __future__ import annotations

import itertools

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED

Array = npt.NDArray[np.float64]

#: Largest number of earlier iterations that are mixed. As many convergence factors are removed at
#: once: with one, laws with two fronts converge slowly. Each takes two vectors of memory.
MOST = 4

#: The residual falls slowly if it is larger than the first part of the residual before. Mixing must
#: reduce the residual to the second part of the present one.
SLOWLY, LEFT = 0.03, 0.5


class Mixing:
    """Mix steps of Newton's method with an inexact derivative with the steps before.

    A law with history variables gives secants where it softens; the residual r then falls by the
    same factor in each iteration. With the steps d_k of the last iterates z_k and differences Δ
    between successive iterations, the mixed step is

        d_k − Σ_j γ_j (Δz_j + Δd_j),   |r_k − Σ_j γ_j Δr_j| → min,

    Anderson mixing of type II (Walker & Ni, SIAM J. Numer. Anal. 49, 2011).

    Args:
        comm: Communicator of the unknowns.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._comm = comm
        self._known: list[tuple[Array, Array, Array]] = []

    def step(self, z: Array, residual: Array, step: Array, is_alike: bool) -> Array | None:
        """The mixed step; None if the Newton step is as good. Collective.

        Args:
            z: The iterate, this rank's part; this holds for the other arrays, too.
            residual: Residual at the iterate, as forces.
            step: Newton step.
            is_alike: Whether R is the same smooth function as at the iterate before, on all ranks.
        """
        self._known = [*(self._known[-MOST:] if is_alike else []), (z, residual, step)]
        if len(self._known) < 2:
            return None
        r = [residual for _, residual, _ in self._known]
        changes = np.array([after - before for before, after in itertools.pairwise(r)])
        rows = np.vstack([changes, r[-1], r[-2]])
        products = np.array(self._comm.allreduce(rows @ rows.T, op=MPI.SUM))
        size, before = np.sqrt(np.diag(products)[-2:])
        if not SLOWLY * before < size:
            return None
        gamma, left = _least(products[:-2, :-2], products[:-2, -2], size**2)
        if not left < LEFT**2 * size**2:
            return None
        out = step.copy()
        for factor, old, new in zip(gamma, self._known, self._known[1:], strict=False):
            out -= factor * (new[0] - old[0] + new[2] - old[2])
        return out


def _least(products: Array, with_residual: Array, square: float) -> tuple[Array, float]:
    """γ and |r − Σ γ_j Δr_j|², from scalar products of the Δr_i, with r, and of r with itself."""
    scale = np.sqrt(np.diag(products))
    if not np.all(scale > 0):
        return np.zeros(len(scale)), square
    matrix, right = products / np.outer(scale, scale), with_residual / scale
    gamma = np.linalg.lstsq(matrix, right, rcond=SOLVED**2)[0] / scale
    left = square - 2 * gamma @ with_residual + gamma @ products @ gamma
    return gamma, float(left)
