"""The ring compression test: closed form, friction's effect, energy, and ranks."""

import functools

from mpi4py import MPI

import numpy as np
import pytest
from common.friction import FRICTIONS
from ring_compression import SPEED, Parameters, build, calibrate, run
from scenes import WORLD, largest

import qsdolfinx as qs

KEYS = (
    "inner_radius_error",
    "inner_radius",
    "outer_radius",
    "force",
    "dissipated_energy",
    "volume_change",
    "steps",
    "snes_iterations",
)
COARSE = {"cells": 3, "num_steps": 4, "reduction": 0.3}


def on_die(ring):
    """Inner and outer radius of the part that lies on the lower die. Collective."""
    x = ring.mesh.geometry.x
    r = x[np.abs(x[:, 1]) < 1e-6, 0]
    inner = WORLD.allreduce(r.min(initial=np.inf), op=MPI.MIN)
    return inner, WORLD.allreduce(r.max(initial=0.0), op=MPI.MAX)


def test_no_friction():
    """Radii follow r √(h₀/h) to second order of the time step; keys are as documented."""
    results = [run(Parameters(**COARSE | {"num_steps": n}), WORLD)[0] for n in (2, 4)]
    errors = [abs(result["inner_radius_error"]) for result in results]
    assert tuple(results[0]) == KEYS
    assert errors[1] < 2e-3 and 3 < errors[0] / errors[1] < 5
    for n, result in zip((2, 4), results, strict=True):
        assert result["dissipated_energy"] == 0 and result["steps"] == n
        assert np.isclose(result["inner_radius"], result["outer_radius"], rtol=1e-8)
        assert abs(result["volume_change"]) < 1e-2
        assert 0 < result["snes_iterations"] < 15 * n


def test_calibration():
    """More friction gives a smaller bore: it grows without friction, and shrinks at 1.

    It hardly changes at 0.15.
    """
    results = [result for result, *_ in calibrate(Parameters(**COARSE), (0, 0.15, 0.4, 1)).values()]
    inner, outer, force, friction = (
        np.array([result[key] for result in results])
        for key in ("inner_radius", "outer_radius", "force", "inner_radius_error")
    )
    assert inner[0] > 1.15 and 0.97 < inner[1] < 1.12 and inner[3] < 0.9
    assert np.all(np.diff(inner) < -0.02) and np.all(np.diff(friction) < -0.02)
    assert np.all(np.diff(outer) < 0)
    assert np.all(np.diff(force) > 0.02 * force[0])


LAWS = {
    "norton": {"alpha": 0.3},
    "coulomb": {"mu": 0.1},
    "tresca": {"m_bar": 0.3},
    "coulomb-tresca": {"mu": 0.2, "m_bar": 0.3},
    "sticking": {},
}


@functools.cache
def compress(friction):
    """Run the demo; returns result, rows, and the state at each step."""
    seen = []

    def on_step(ring, contacts, stepper):
        with_friction = [contact for contact in contacts if contact.friction is not None]
        least = min((c.dissipation().min(initial=0) for c in with_friction), default=0.0)
        middle = [radius * start for radius, start in zip(ring.radii(), (7.5, 15), strict=True)]
        seen.append(
            {
                "least": WORLD.allreduce(least, op=MPI.MIN),
                "step": sum(contact.step_dissipation() for contact in contacts),
                "dissipated": sum(contact.dissipated_energy() for contact in contacts),
                "die": on_die(ring),
                "middle": middle,
                "cutbacks": stepper.num_cutbacks,
            }
        )

    p = Parameters(friction=friction, **COARSE, **LAWS.get(friction, {}))
    result, rows, _ = run(p, WORLD, on_step)
    return result, rows, seen


@pytest.mark.parametrize("friction", FRICTIONS)
def test_energy(friction):
    """The dies' work is the sum of plastic and friction dissipation, nonnegative at each node."""
    result, rows, seen = compress(friction)
    total = 0.0
    for row, state in zip(rows, seen, strict=True):
        total += state["step"]
        assert state["least"] >= 0
        assert np.isclose(state["dissipated"], total, rtol=1e-12)
        assert state["cutbacks"] == 0
        # Where no node gains or loses contact with a die, each step is in balance.
        assert abs(row["energy_error"]) < 1e-7
        assert np.isclose(row["plastic"] + row["friction"], row["work"], rtol=1e-7)
    share = total / rows[-1]["work"]
    assert result["dissipated_energy"] == total or np.isclose(total, result["dissipated_energy"])
    if friction in ("none", "sticking"):
        assert abs(share) < 1e-6
    else:
        assert 0.03 < share < 0.3


@pytest.mark.parametrize("friction", FRICTIONS)
def test_barrelling(friction):
    """Friction restrains the faces: at mid height the ring flows further, outwards or inwards."""
    state = compress(friction)[2][-1]
    (inner, outer), (bore, girth) = state["die"], state["middle"]
    if friction == "none":
        np.testing.assert_allclose((bore, girth), (inner, outer), rtol=1e-6)
    else:
        assert girth > 1.01 * outer
        assert bore < 0.99 * inner if bore < 7.5 else bore > inner
    if friction == "sticking":
        np.testing.assert_allclose((inner, outer), (7.5, 15.0), rtol=1e-6)


def test_laws_agree():
    """Coulomb's law limited by Tresca's equals Tresca's law where pressures are high."""
    results = [
        run(Parameters(friction=friction, mu=10.0, m_bar=0.3, **COARSE), WORLD)[0]
        for friction in ("tresca", "coulomb-tresca")
    ]
    for key in ("inner_radius", "outer_radius", "force", "dissipated_energy"):
        assert np.isclose(results[0][key], results[1][key], rtol=1e-6), key


def test_folding():
    """Sides that fold on to the dies do not penetrate them.

    The energy error is that of the time step.
    """
    p = Parameters(friction="tresca", m_bar=1.0, cells=4, num_steps=10)
    _, rows, ring = run(p, WORLD)
    z = ring.mesh.geometry.x[:, 1]
    deepest = largest(np.maximum(np.maximum(-z, z - 5.0), 0))
    assert deepest < 1e-6
    assert rows[2]["area_1"] == 0 and rows[-1]["area_1"] > 0 and rows[-1]["area_3"] > 0
    assert abs(rows[-1]["energy_error"]) < 0.01


@pytest.mark.parametrize("friction", ("norton", "coulomb-tresca"))
def test_ranks_do_not_matter(friction):
    p = Parameters(friction=friction, **COARSE | {"num_steps": 2})
    results = [run(p, comm)[0] for comm in (MPI.COMM_SELF, WORLD)]
    for key in KEYS[1:5]:
        assert np.isclose(results[0][key], results[1][key], rtol=1e-7), key


@pytest.mark.parametrize("ratio", (0.95, 0.8))
def test_friction_is_not_lost(ratio):
    """With a slower die, sticking nodes still stick.

    Newton's full steps activate and deactivate contact.
    """
    ring, _, stepper = build(WORLD, Parameters(friction="sticking", cells=4))
    stepper.step()
    before = on_die(ring)
    tool = stepper.tools[-1]

    def drive(t, dt):
        tool.displacement = [0, -ratio * SPEED * dt]

    qs.TimeStepper(stepper.problem, stepper.dt, drive).step()  # no continuation
    after = on_die(ring)
    np.testing.assert_allclose(after, before, rtol=1e-7)
