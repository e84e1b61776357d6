"""Cases of bench/verified.py at the smallest size: differences from published results."""

import numpy as np
import pytest
import verified
from scenes import WORLD

#: Cases that take a second or less.
EACH_TIME = (
    "boussinesq_punch",
    "calculix_friction1",
    "calculix_hueeber1",
    "calculix_ring2",
    "four_bodies",
    "greco_plate",
    "klang_pin",
    "sliding_wedge",
    "sneddon_cone",
)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in EACH_TIME else pytest.mark.long) for n in verified.names()],
)
def test_case(name):
    """Differences from the references are below the limit of the case for its coarse meshes."""
    rows = verified.case(name).run(True, WORLD)
    assert rows
    far = verified.case(name).FAR
    for row in rows:
        assert np.isfinite(row.ours) and row.source, row
        assert abs(row.difference) < far, (row.quantity, row.reference, row.ours)
    text = verified.section(name, rows, 0.0)
    assert text.count("\n| ") == len(rows) + 1
