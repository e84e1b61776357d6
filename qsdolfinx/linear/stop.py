"""End long linear solves early after Ctrl-C."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

from qsdolfinx.base import interrupt
from qsdolfinx.base.passing import passing

#: Number of iterations after which the ranks communicate whether to end. With 1, each iteration
#: waits for all ranks; with many, Ctrl-C has to wait.
EVERY = 5


class Stop:
    """End a Krylov solver by its iteration limit, which leaves PETSc in a valid state.

    This object must not refer to the solver: PETSc keeps it where Python's garbage collector does
    not see it.

    Args:
        ksp: The solver.
        comm: MPI communicator of the solver.
    """

    def __init__(self, ksp: PETSc.KSP, comm: MPI.Intracomm) -> None:
        self._comm = comm
        self._limit: int | None = None
        ksp.setMonitor(self.monitor)

    @passing()
    def monitor(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        """Monitor that PETSc calls at each iteration: check whether to end. Collective."""
        if self._limit is None and iteration % EVERY == 0 and interrupt.requested(self._comm):
            self._limit = ksp.getTolerances()[3]
            ksp.setTolerances(max_it=max(iteration, 1))

    def look(self, ksp: PETSc.KSP) -> None:
        """Raise an error after a solve that was interrupted by Ctrl-C. Collective.

        Args:
            ksp: The solver.

        Raises:
            KeyboardInterrupt: See :func:`interrupt.look`.
        """
        if self._limit is not None:
            ksp.setTolerances(max_it=self._limit)
            self._limit = None
        interrupt.look(self._comm)
