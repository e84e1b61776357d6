"""Random scenes in equilibrium, by the auditor's own means; other ones on each number of ranks."""

from mpi4py import MPI

import pytest
from audit.run import run

SIZE = MPI.COMM_WORLD.size


def check(numbers, units=False):
    faults = []
    counts = run(numbers, units, faults.append)
    assert counts["FAULT"] == 0, "\n".join(faults)
    assert counts["good"] > 0.9 * len(numbers)


def test_some():
    check(range(100 * (SIZE - 1), 100 * SIZE))


@pytest.mark.long
def test_many():
    check(range(10_000, 11_000))


@pytest.mark.long
def test_odd_units():
    check(range(20_000, 21_000), units=True)
