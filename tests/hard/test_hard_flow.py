"""Viscoplastic flow at m = 0.05 on a die: steady, at rest, and when the rate jumps by 1e6."""

import pytest
from hard import flow
from hard.scenes import Variant
from scenes import WORLD

KINDS = (
    Variant("quasi-symmetric", "overlay", "penalty"),
    Variant("quasi-symmetric", "nodal", "augmented-lagrangian"),
)


@pytest.mark.parametrize("kind", KINDS, ids=" ".join)
@pytest.mark.parametrize("number", range(3), ids=("steady", "jump", "rest"))
def test_flow(number, kind):
    case = list(flow.checks(kind))[number]
    error, _ = case.run()
    assert max(WORLD.allgather(error)) <= case.allowed
