"""The forging demo: dies finer than the workpiece, under each formulation."""

import csv
import dataclasses
import functools
import itertools

import numpy as np
import pytest
from forging import FORMULATIONS, Parameters, run
from scenes import WORLD

import qsdolfinx as qs

KEYS = (
    "forming_force",
    "force_balance_error",
    "die_traction_peak",
    "die_traction_roughness",
    "unloaded_die_nodes",
    "volume_change",
    "steps",
    "snes_iterations",
    "total_seconds",
)


@functools.cache
def forge(formulation="quasi-symmetric", quadrature="overlay", swap=False, enforcement="penalty"):
    p = dataclasses.replace(
        Parameters(),
        formulation=formulation,
        quadrature=quadrature,
        swap=swap,
        enforcement=enforcement,
        die_refinement=3.5,
        reduction=0.02,
        num_steps=1,
    )
    return run(p, WORLD)[0]


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_every_formulation(formulation, quadrature):
    result = forge(formulation, quadrature)
    assert tuple(result) == KEYS
    assert result["steps"] == 1
    if formulation != "two-half-pass":  # whose two sides have multipliers of their own
        assert result["force_balance_error"] < 1e-8
    assert abs(result["volume_change"]) < 1e-4


def test_traction_on_the_dies():
    """Master-slave leaves die nodes without load, quasi-symmetric contact half of that."""
    one_sided, nodal = (forge(f, "nodal") for f in ("master-slave", "quasi-symmetric"))
    overlay = forge()
    assert one_sided["unloaded_die_nodes"] > 0.1
    assert nodal["unloaded_die_nodes"] == 0
    roughness = [r["die_traction_roughness"] for r in (one_sided, nodal, overlay)]
    assert roughness[1] < 0.6 * roughness[0]
    assert roughness[2] < 0.1
    assert overlay["unloaded_die_nodes"] == 0


def test_swap():
    forces = [forge(swap=swap)["forming_force"] for swap in (False, True)]
    assert abs(forces[1] / forces[0] - 1) < 5e-3


def test_enforcement():
    """The penalty costs little: the dies are where they should be to its compliance."""
    forces = [forge(enforcement=e)["forming_force"] for e in ("penalty", "augmented-lagrangian")]
    assert np.isclose(*forces, rtol=5e-3)


def test_restart(tmp_path, monkeypatch):
    """A run that was stopped and goes on has the same history, energies included."""
    root = WORLD.bcast(tmp_path)
    p = dataclasses.replace(Parameters(), die_refinement=2.0, reduction=0.04, num_steps=2)

    def history(folder):
        WORLD.barrier()
        with (folder / "history.csv").open(newline="") as file:
            return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]

    whole, _ = run(dataclasses.replace(p, output=str(root / "whole")), WORLD)
    stopped = dataclasses.replace(p, output=str(root / "stopped"))
    steps = qs.TimeStepper.run
    with monkeypatch.context() as patch:
        patch.setattr(
            qs.TimeStepper, "run", lambda self, t_end: itertools.islice(steps(self, t_end), 1)
        )
        run(stopped, WORLD)
    resumed, _ = run(dataclasses.replace(stopped, restart=True), WORLD)
    rows, expected = history(root / "stopped"), history(root / "whole")
    assert len(rows) == len(expected) == 2
    for row, other in zip(rows, expected, strict=True):
        for key, value in other.items():
            if "force" not in key or key.endswith("z"):  # the others are differences of large ones
                assert np.isclose(row[key], value, rtol=1e-9, atol=1e-12), key
    assert np.isclose(resumed["forming_force"], whole["forming_force"], rtol=1e-12)
    names = {path.name for path in (root / "stopped").iterdir()}
    assert {"workpiece.xdmf", "workpiece_from_1.xdmf", "upper_die_from_1.xdmf"} <= names
