"""Log one line for each solve, for verbose problems."""

from __future__ import annotations

import contextlib
import time
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.messages import say
from qsdolfinx.contact import results
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.solve.newton import Newton, Record
from qsdolfinx.solve.snes import ConvergenceError


@contextlib.contextmanager
def summary(newton: Newton, verbose: bool) -> typing.Iterator[None]:
    """Log one line about the solve in the block, if verbose. Collective in this case."""
    if not verbose:
        yield
        return
    comm, begin = newton.system.comm, time.perf_counter()
    try:
        yield
    except ConvergenceError as error:
        say(comm, f"solve failed: {error.reason_name}, {_effort(newton.record, begin)}")
        raise
    outcome = _outcome(comm, newton.system.contacts, newton.record)
    say(comm, f"solve: {_effort(newton.record, begin)}; {outcome}")


def _effort(record: Record, begin: float) -> str:
    """Iterations and time."""
    parts = [f"{record.iterations} Newton, {record.linear_iterations} linear iterations"]
    if record.restarts:
        parts.append(f"{record.restarts} restart{'s' * (record.restarts > 1)}")
    return ", ".join([*parts, f"{time.perf_counter() - begin:.2f} s"])


def _outcome(comm: MPI.Intracomm, contacts: typing.Sequence[ContactModel], record: Record) -> str:
    """Active constraints, gaps and forces, for one contact after the other. Collective."""
    rows = [sum(p.num_rows for p in contact.gaps) for contact in contacts]
    rows = comm.allreduce(np.array(rows, dtype=np.int64), op=MPI.SUM).tolist()
    history = record.active_of_all(comm)
    active = history[-1] if history else [0] * len(contacts)
    gap = max((results.weighted_penetration(contact) for contact in contacts), default=0.0)
    forces = [float(np.linalg.norm(results.total(contact, "slave"))) for contact in contacts]
    counts = " + ".join(f"{a} of {n}" for a, n in zip(active, rows, strict=True))
    return (
        f"active constraints {counts or 0}, largest gap violation {gap:.3g}, "
        f"force {' + '.join(f'{f:.6g}' for f in forces) or 0}"
    )
