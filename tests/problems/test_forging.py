"""The forging demo: dies finer than the workpiece, under each formulation."""

import csv
import dataclasses
import functools
import itertools

from mpi4py import MPI

import forging
import numpy as np
import pytest
from common.command import FORMULATIONS
from forging import Parameters, run
from forging_output import barrelling
from scenes import WORLD, largest

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


#: Cell size of the demo itself.
CELLS = forging.SIZES["coarse"]


@pytest.fixture(autouse=True)
def large_cells(monkeypatch):
    """Use larger cells than the demo; they are fine enough for these tests."""
    monkeypatch.setitem(forging.SIZES, "coarse", 3.5)


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
    assert result["force_balance_error"] < 1e-8
    assert abs(result["volume_change"]) < 1e-4


def test_traction_on_the_dies():
    """Master-slave contact leaves die nodes unloaded; quasi-symmetric contact halves its error."""
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


@pytest.mark.long
def test_enforcement(monkeypatch):
    """With a penalty the dies are in place up to its compliance; the force hardly changes."""
    monkeypatch.setitem(forging.SIZES, "coarse", CELLS)  # smaller error than larger cells
    forces = [
        forge.__wrapped__(enforcement=e)["forming_force"]
        for e in ("penalty", "augmented-lagrangian")
    ]
    assert np.isclose(*forces, rtol=5e-3)


LAWS = {
    "norton": {"alpha": 0.3},
    "coulomb-tresca": {"mu": 0.3, "m_bar": 0.6},
    "sticking": {},
}


@functools.cache
def forge_with_friction(friction):
    """Result, history, radii at mid height and at the dies, and dissipation at the nodes."""
    rows, least = [], [0.0]
    add = qs.History.add

    def keep(history, row):
        rows.append(dict(row))
        add(history, row)

    steps = qs.TimeStepper.run

    def watch(stepper, t_end):
        for t in steps(stepper, t_end):
            contacts = [c for c in stepper.problem.contacts if c.friction is not None]
            least.extend(c.dissipation().min(initial=0.0) for c in contacts)
            yield t

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(qs.History, "add", keep)
        patch.setattr(qs.TimeStepper, "run", watch)
        p = dataclasses.replace(
            Parameters(), friction=friction, die_refinement=1.5, reduction=0.08, num_steps=2
        )
        result, scene = run(dataclasses.replace(p, **LAWS.get(friction, {})), WORLD)
    return result, rows, barrelling(scene[0]), WORLD.allreduce(min(least), op=MPI.MIN)


@pytest.mark.parametrize("friction", LAWS)
def test_friction(friction):
    """Friction makes the force larger and the workpiece barrel-shaped; energies add up."""
    (free, before, straight, _), (result, rows, radii, least) = (
        forge_with_friction(f) for f in ("none", friction)
    )
    assert tuple(result) == KEYS
    assert result["forming_force"] > 1.02 * free["forming_force"]
    assert straight[0] / straight[1] < 1.001
    assert radii[0] / radii[1] > 1.01
    assert result["force_balance_error"] < 1e-8
    assert least >= 0
    assert [row["cutbacks"] for row in rows] == [0, 0]
    # The missing energy is stored by the penalty while the dies close in.
    assert 0 < rows[-1]["energy_error"] < (0.05 if friction == "sticking" else 0.03)
    assert "friction" not in before[-1]
    taken = [row["friction"] for row in rows]
    if friction == "sticking":
        assert abs(taken[1]) < 1e-4 * rows[1]["work"]  # at most three pressures
    else:
        assert 0.01 * rows[1]["work"] < taken[0] + taken[1] and taken[0] < taken[1]


def state_of_friction(contacts):
    """Numbers to compare slip, τ and dissipation of two runs on any partition. Collective."""
    sums = []
    for contact in contacts if contacts[0].friction is not None else ():
        surface = contact.slave
        wave = np.sin(surface.node_x @ [[1.0, 0.3], [0.7, -1.1], [0.2, 0.5]]).T * surface.node_area
        for values in (contact.slip(), contact.tangential_multiplier(), contact.dissipation()):
            size = np.abs(values) if values.ndim == 1 else np.linalg.norm(values, axis=1)
            sums += [*WORLD.allreduce(wave @ size), largest(values)]
        sums.append(contact.dissipated_energy())
    return sums


@pytest.mark.parametrize(
    "friction",
    [*(pytest.param(f, marks=pytest.mark.long) for f in ("none", "norton")), "coulomb-tresca"],
)
def test_restart(tmp_path, monkeypatch, friction):
    """A run that is stopped and restarted has the same history, with energies and slip."""
    root = WORLD.bcast(tmp_path)
    p = dataclasses.replace(Parameters(), die_refinement=2.0, reduction=0.04, num_steps=2)
    p = dataclasses.replace(p, friction=friction, **LAWS.get(friction, {}))

    def history(folder):
        WORLD.barrier()
        with (folder / "history.csv").open(newline="") as file:
            return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]

    whole, scene = run(dataclasses.replace(p, output=str(root / "whole")), WORLD)
    stopped = dataclasses.replace(p, output=str(root / "stopped"))
    steps = qs.TimeStepper.run
    with monkeypatch.context() as patch:
        patch.setattr(
            qs.TimeStepper, "run", lambda self, t_end: itertools.islice(steps(self, t_end), 1)
        )
        run(stopped, WORLD)
    resumed, again = run(dataclasses.replace(stopped, restart=True), WORLD)
    states = [state_of_friction(contacts) for contacts in (again[2], scene[2])]
    rows, expected = history(root / "stopped"), history(root / "whole")
    assert len(rows) == len(expected) == 2
    for row, other in zip(rows, expected, strict=True):
        for key, value in other.items():
            if "force" not in key or key.endswith("z"):  # others: differences of large ones
                assert np.isclose(row[key], value, rtol=1e-6, atol=1e-12), key
    assert np.isclose(resumed["forming_force"], whole["forming_force"], rtol=1e-8)
    np.testing.assert_allclose(states[0], states[1], rtol=1e-5)
    assert ("friction" in rows[0]) == (friction != "none")
    names = {path.name for path in (root / "stopped").iterdir()}
    assert {"workpiece.xdmf", "workpiece_from_1.xdmf", "upper_die_from_1.xdmf"} <= names
