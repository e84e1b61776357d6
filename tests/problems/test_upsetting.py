"""Convergence under refinement: the demo at a small size."""

import pytest
from common.command import FORMULATIONS
from common.tables import check_upsetting
from scenes import WORLD
from upsetting_convergence import CELLS, Parameters, run


@pytest.fixture(scope="module")
def result():
    return run(Parameters(levels=3, penalty_factor=1e4), WORLD)


def test_its_own_check(result):
    check_upsetting(result, CELLS)


def test_matching_meshes_converge_as_the_single_body(result):
    single = result["rate_energy_single"]
    assert 0.85 < single < 1.0
    for f in FORMULATIONS:
        assert abs(result[f"rate_energy_{f}_1:1"] - single) < 0.01


@pytest.mark.parametrize("ratio", ["2:3", "3:2", "4:1"])
def test_quasi_symmetric_halves_the_error_of_the_traction(result, ratio):
    """On non-nested meshes nodal contact loses order; quasi-symmetric contact halves the error."""
    for level in range(3):
        ms, quasi = (
            result[f"error_master_traction_{f}_{ratio}_{level}"]
            for f in ("master-slave", "quasi-symmetric")
        )
        assert 0.2 < quasi / ms < 0.75


def test_penalty_error_is_below_that_of_the_meshes(result):
    """With a tenth of the penalty the energy error is the same to a few per cent."""
    softer = run(Parameters(levels=2, penalty_factor=1e3), WORLD)
    for ratio in CELLS:
        key = f"error_energy_quasi-symmetric_{ratio}_1"
        # The mesh of level 1 is the same; the reference is coarser by one level.
        assert abs(softer[key] / result[key] - 1) < 0.03
