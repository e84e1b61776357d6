"""The forging demo: dies finer than the workpiece, under each formulation."""

import dataclasses
import functools

import numpy as np
import pytest
from forging import FORMULATIONS, Parameters, run
from scenes import WORLD

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
