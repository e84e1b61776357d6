"""Demos of machine parts at the smallest size: each script's own checks, and its picture."""

import functools
import importlib
import json
import pathlib
import sys

import pytest
from project.pages import scratch_folder
from scenes import WORLD

import qsdolfinx as qs

pytest.importorskip("gmsh")
pytest.importorskip("matplotlib")

#: Arguments with which each script ends within some seconds.
SMALL = {
    "oring": ["--facet", "0.3"],
    "press_fit": ["--cells", "12"],
    "ball_in_socket": ["--h", "0.4"],
    "gear_pair": ["--h", "0.12", "--steps", "2"],
}


@functools.cache
def done(name):
    """Run as from the command line: limits, results, and the size of the picture (bytes)."""
    script = importlib.import_module(name)
    files = ["--json", "result.json", "--plot", "picture.png"]
    with scratch_folder(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [name, *SMALL[name], *files])
        script.main()
        WORLD.barrier()
        result = json.loads(pathlib.Path("result.json").read_text())
        return script.LIMITS, result, pathlib.Path("picture.png").stat().st_size


@pytest.mark.parametrize("name", SMALL)
def test_limits(name):
    """Results keep the limits: closed forms, balances and published numbers."""
    limits, result, size = done(name)
    assert limits and {key for key in limits if not abs(result[key]) <= limits[key]} == set()
    assert 10e3 < size < 150e3


def test_linear_displacements_lock():
    """Displacements of degree 1 are far too stiff; degree 2 agrees with the mixed formulation."""
    _, result, _ = done("oring")
    assert result["force_error_p1"] > 0.15
    assert abs(result["force_error_p2"] - result["force_error_mixed"]) < 5e-3


def test_a_guess_that_changes_volumes(monkeypatch):
    """If the prediction changes volumes, steps are solved from their start, and none is cut back.

    The first Newton step from the prediction does not lead to the solution.
    """
    script, step, steppers = importlib.import_module("oring"), qs.TimeStepper.step, []

    def stepped(stepper, *args, **kwargs):
        steppers.append(stepper)
        return step(stepper, *args, **kwargs)

    monkeypatch.setattr(qs.TimeStepper, "step", stepped)
    script.squeeze(WORLD, script.Parameters(), "p2")
    assert steppers[-1].num_cutbacks == 0


def test_pulling_takes_from_the_pressure():
    """The force is smaller than that of a constant pressure: pulling reduces the pressure.

    The closed form gives the difference.
    """
    _, result, _ = done("press_fit")
    assert result["force"] < 0.975 * result["simple_force"]


def test_facets_fill_a_small_clearance():
    """Chords with a height of a third of the clearance spoil the pressure, curved facets do not."""
    _, result, _ = done("ball_in_socket")
    assert abs(result["coarse_peak_error_facets"]) > 0.3
    assert abs(result["peak_error_facets"]) > 3 * abs(result["peak_error_curvature"])


def test_two_pairs_of_teeth_are_stiffer():
    _, result, _ = done("gear_pair")
    assert 1.3 < result["largest_torque"] / result["torque"] < 1.7
