"""Cases of bench/verified.py at their smallest size: how far from what others give."""

import numpy as np
import pytest
import verified
from scenes import WORLD

#: Those that take a second or less.
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
    """Nearer to the references than the case says of its coarse meshes, where they are no guess."""
    rows = verified.case(name).run(True, WORLD)
    assert rows
    far = verified.case(name).FAR
    for row in rows:
        assert np.isfinite(row.ours) and row.source, row
        assert abs(row.difference) < far, (row.quantity, row.reference, row.ours)
    text = verified.section(name, rows, 0.0)
    assert text.count("\n| ") == len(rows) + 1
