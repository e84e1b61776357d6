"""Cases of bench/verified.py at their smallest size: how far from what others give."""

import numpy as np
import pytest
import verified
from scenes import WORLD


@pytest.mark.parametrize("name", verified.names())
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
