"""A block dragged over another: the demo's own checks, and what its table must show."""

import json
import sys

import block_on_block
import numpy as np
import pytest
from block_on_block import LOAD, Parameters, build, run
from common.command import FORMULATIONS
from scenes import WORLD

KEYS = [
    "friction_force_error",
    "partial_slip_seen",
    "min_dissipation",
    "stick_dissipation",
    "energy_error",
    "force_balance_error",
    "snes_iterations",
]


def column(table, name):
    return np.array([row[name] for row in table])


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_full_slip(formulation, quadrature):
    """T = μ N; at steady slip the drag's work equals the friction dissipation; forces balance."""
    result, table = run(Parameters(formulation=formulation, quadrature=quadrature, push=4e-3))
    assert list(result) == KEYS
    assert result["friction_force_error"] < 1e-6
    assert result["partial_slip_seen"] == 1
    assert result["min_dissipation"] >= 0 and result["stick_dissipation"] == 0
    assert result["force_balance_error"] < 1e-10
    assert abs(result["energy_error"]) < 1e-3
    assert result["snes_iterations"] == sum(row["iterations"] for row in table)


def test_states():
    """Nodes mostly stick at first, then in part, then slip; T grows and stays below μ N."""
    _, table = run(Parameters(enforcement="penalty"))
    ratio, stick, energy = (column(table, name) for name in ("ratio", "stick", "energy"))
    assert abs(ratio[0]) < 1e-10
    assert stick[1] > 0.7 and np.any((stick > 0.1) & (stick < 0.5)) and stick[-1] == 0
    assert np.all(np.diff(ratio) > -1e-9) and ratio.max() < 1 + 1e-9
    assert np.all(np.diff(energy) >= 0)
    assert np.allclose(np.diff(energy, prepend=0), column(table, "step_energy"), atol=1e-15)
    # While most nodes stick, friction dissipates little of the drag's work.
    shift, force = column(table, "shift")[:4], ratio[:4] * 0.3 * LOAD
    work = np.sum(np.diff(shift) * (force[1:] + force[:-1]) / 2)
    assert 0 < energy[3] - energy[0] < 0.2 * work


def test_sticking_alone():
    """With a large μ nothing slips, and friction dissipates nothing."""
    upper, contact, problem = build(WORLD, Parameters(mu=50.0))
    for shift in (0.0, 0.002, 0.004):
        upper.shift.value = shift
        problem.solve()
        slipping = WORLD.allreduce(int(contact.slipping().sum()))
        assert slipping == 0 and contact.step_dissipation() == 0
    assert upper.reaction()[0] > 0.01 * LOAD and contact.dissipated_energy() == 0


def test_augmented_lagrangian():
    """Friction is right at full slip; while sticking it is that of a stiff penalty.

    The penalty is 100, at nodes.
    """
    result, table = run(Parameters(push=1.2e-2))
    _, other = run(Parameters(push=1.2e-2, quadrature="nodal", enforcement="penalty"))
    assert result["friction_force_error"] < 1e-6
    assert result["force_balance_error"] < 1e-10
    assert abs(result["energy_error"]) < 1e-3
    np.testing.assert_allclose(column(table, "ratio")[:2], column(other, "ratio")[:2], 0.05, 1e-9)


def test_command(monkeypatch, tmp_path, capsys):
    """--json writes the keys, and --plot writes a picture."""
    names = [WORLD.bcast(str(tmp_path / name)) for name in ("block.json", "block.png")]
    arguments = ["block_on_block.py", "--push", "1.2e-2", "--json", names[0], "--plot", names[1]]
    monkeypatch.setattr(sys, "argv", arguments)
    block_on_block.main()
    WORLD.barrier()
    with open(names[0]) as file:
        result = json.load(file)
    with open(names[1], "rb") as file:
        picture = file.read()
    assert list(result) == KEYS and result["friction_force_error"] < 1e-6
    assert picture.startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert WORLD.rank > 0 or "energy taken" in printed
