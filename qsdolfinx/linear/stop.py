"""Long linear solves end early after Ctrl-C."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

from qsdolfinx.base import interrupt
from qsdolfinx.base.passing import passing

#: Iterations after which ranks tell each other.
EVERY = 5


class Stop:
    """Ends a Krylov solver by its limit of iterations, so that PETSc leaves all of it whole.

    It must not refer to the solver: PETSc keeps it where Python's garbage collector does not look.

    Args:
        ksp: The solver.
        comm: Its communicator, MPI's own.
    """

    def __init__(self, ksp: PETSc.KSP, comm: MPI.Intracomm) -> None:
        self._comm = comm
        self._limit: int | None = None
        ksp.setMonitor(self.monitor)

    @passing()
    def monitor(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        """Look whether to end: what PETSc calls at each iteration. Collective."""
        if self._limit is None and iteration % EVERY == 0 and interrupt.requested(self._comm):
            self._limit = ksp.getTolerances()[3]
            ksp.setTolerances(max_it=max(iteration, 1))

    def look(self, ksp: PETSc.KSP) -> None:
        """Raise after a solve that was to end, or that ended as Ctrl-C came. Collective.

        Args:
            ksp: The solver.

        Raises:
            KeyboardInterrupt: See :func:`interrupt.look`.
        """
        if self._limit is not None:
            ksp.setTolerances(max_it=self._limit)
            self._limit = None
        interrupt.look(self._comm)
