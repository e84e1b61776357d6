"""Upsetting of a cylinder: the demo against the closed form."""

import pytest
from scenes import WORLD
from upset_cylinder import Parameters, run


@pytest.mark.parametrize("m", [1.0, 0.5, 0.15])
@pytest.mark.parametrize("dim", [2, 3])
def test_closed_form(dim, m):
    few = {"num_steps": 3, "reduction": 0.15} if dim == 3 else {"num_steps": 12}
    result, stepper = run(Parameters(m=m, dim=dim, **few), WORLD)
    keys = ["force_error", "volume_change", "steps", "snes_iterations", "total_seconds"]
    assert list(result) == keys
    assert result["force_error"] < 2e-3
    assert abs(result["volume_change"]) < 2e-3
    assert result["steps"] == stepper.num_steps == few["num_steps"]
    assert 0 < result["snes_iterations"] < 15 * few["num_steps"]


def test_euler_drifts():
    """The volume drifts with Euler's scheme, and over ten times less with the midpoint rule."""
    few = {"m": 1.0, "num_steps": 4, "reduction": 0.2}
    drift = [run(Parameters(scheme=s, **few))[0]["volume_change"] for s in ("midpoint", "euler")]
    assert abs(drift[1]) > 10 * abs(drift[0])
