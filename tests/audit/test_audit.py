"""Random scenes in equilibrium, by the auditor's own means; other ones on each number of ranks."""

from mpi4py import MPI

import pytest
from audit.run import run

SIZE = MPI.COMM_WORLD.size


@pytest.mark.parametrize(
    "units, first, count",
    [
        (False, 100 * (SIZE - 1), 100),
        pytest.param(False, 10_000, 1000, marks=pytest.mark.long),
        pytest.param(True, 20_000, 1000, marks=pytest.mark.long),
    ],
    ids=["some", "many", "units"],
)
def test_scenes(units, first, count):
    faults = []
    counts = run(range(first, first + count), units, faults.append)
    assert counts["FAULT"] == 0, "\n".join(faults)
    assert counts["good"] > 0.9 * count
