"""Crumple a few bodies into self-contact; tests/audit/crumple.py runs many."""

import pytest
from audit.crumple import run


@pytest.mark.parametrize("sliding", ("finite", pytest.param("small", marks=pytest.mark.long)))
def test_strips(sliding):
    faults = []
    counts = run([1, 13], 2, sliding, faults.append)
    assert counts["FAULT"] == 0, "\n".join(faults)
    assert counts["good"] + counts["warned"] == 2 and counts["touching"] > 0
