"""Crumple a few bodies into self-contact; tests/audit/crumple.py runs many."""

import pytest
from audit.crumple import Crumpled, random_scene, run


@pytest.mark.parametrize("sliding", ("finite", pytest.param("small", marks=pytest.mark.long)))
def test_strips(sliding):
    faults = []
    counts = run([1, 13], 2, sliding, faults.append)
    assert counts["FAULT"] == 0, "\n".join(faults)
    assert counts["good"] + counts["warned"] == 2 and counts["touching"] > 0


def test_quadrilaterals():
    """The audit divides quadrilaterals into triangles, whose common corner has no force."""
    crumpled = Crumpled(random_scene(1, 3))
    try:
        assert crumpled.scene.cell == "hexahedron"
        assert not next(crumpled.steps())
    finally:
        crumpled.destroy()
