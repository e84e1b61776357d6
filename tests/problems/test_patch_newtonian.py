"""The patch test with Newtonian cubes: exact on the overlay, ratio of the formulations, ranks."""

from mpi4py import MPI

import numpy as np
import patch_test
import pytest
from common.command import FORMULATIONS
from patch_bodies import MATERIALS, STRESS, VISCOSITY
from patch_test import Parameters, reference_stress, run
from scenes import WORLD, spread_cells

CELLS = ("triangle", "tetrahedron")
LOADS = ("pressure", "displacement")
SIDES = ("slave", "master")
ERRORS = [f"{side}_{kind}_error" for side in SIDES for kind in ("mean", "max", "nodal_max")]


def newtonian(*args, **kwargs):
    return Parameters(*args, material="newtonian", **kwargs)


def check_exact(result, tolerance=1e-8):
    for name in ERRORS:
        assert result[name] < tolerance, name
    assert result["force_imbalance"] < 1e-12


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("cell", CELLS)
def test_reference(cell, load):
    """A single body of both cubes has the stress of the uniform flow."""
    assert np.isclose(reference_stress(WORLD, newtonian(5, 3, cell, load=load)), STRESS, rtol=1e-10)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("jitter", (0.0, 0.25))
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("cell", CELLS)
def test_overlay_is_exact(cell, load, jitter, enforcement):
    for contact in ("tied", "unilateral"):
        options = {"load": load, "contact": contact, "enforcement": enforcement}
        result, _ = run(newtonian(5, 3, cell, jitter, 2, quadrature="overlay", **options))
        check_exact(result)
        compliance = 65 / result["penalty"] if enforcement == "penalty" else 0.0
        assert np.isclose(result["gap_max"], compliance, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_formulations(cell, formulation):
    """Contact is exact with the overlay, and on matching meshes with either quadrature."""
    check_exact(run(newtonian(5, 3, cell, 0.1, formulation=formulation, quadrature="overlay"))[0])
    for load in LOADS:
        check_exact(run(newtonian(4, 4, cell, formulation=formulation, load=load))[0])


@pytest.mark.parametrize("penalty", ("auto", 1e9))
@pytest.mark.parametrize("jitter", (0.0, 0.25))
@pytest.mark.parametrize("load", LOADS)
def test_quasi_symmetric_halves_the_error(load, jitter, penalty):
    """With a master finer than the slave, quasi-symmetric contact halves the error.

    This holds at any penalty.
    """
    options = {"jitter": jitter, "load": load, "penalty": penalty}
    for master, slave in ((4, 3), (8, 3)):
        quasi, single = (
            run(newtonian(master, slave, formulation=formulation, **options))[0]
            for formulation in ("quasi-symmetric", "master-slave")
        )
        for result in (quasi, single):
            assert result["force_imbalance"] < 1e-12
            assert result["snes_iterations"] == 1 or penalty == 1e9
        for side in SIDES:
            mean, maximum = f"{side}_mean_error", f"{side}_max_error"
            assert quasi[mean] <= 0.55 * single[mean], (master, slave, side)
            assert quasi[maximum] <= 0.75 * single[maximum], (master, slave, side)


@pytest.mark.parametrize("cell", CELLS)
def test_flow(cell):
    """The constant stress gives an incompressible velocity field, plane strain in 2D."""
    p = newtonian(5, 3, cell, 0.2, quadrature="overlay")
    master, slave, contact, problem = patch_test.build(WORLD, p)
    problem.solve()
    rate = 65 / ((3 if cell == "tetrahedron" else 4) * VISCOSITY)
    for body, jump in ((master, 0.0), (slave, 65 / contact.penalty)):
        v = body.u.sub(0).collapse()
        body.exact.interpolate(lambda x, gdim=body.gdim, jump=jump: velocity(x[:gdim], rate, jump))
        difference = v.x.array - body.exact.x.array
        assert WORLD.allreduce(np.max(np.abs(difference), initial=0.0), op=MPI.MAX) < 1e-11
    problem.destroy()


def velocity(x, rate, jump):
    up = len(x) - 1
    v = rate / up * x
    v[up] = -rate * x[up] - jump
    return v


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", CELLS)
def test_ranks_do_not_matter(cell, quadrature, monkeypatch):
    p = newtonian(5, 3, cell, 0.2, 1, load="displacement", quadrature=quadrature)
    expected, _ = run(p, MPI.COMM_SELF)
    results = [run(p)[0]]
    for partition in ("scattered", "last"):
        with spread_cells(monkeypatch, partition):
            results.append(run(p)[0])
    for result in results:
        for name in (*ERRORS, "gap_max"):
            assert np.isclose(result[name], expected[name], rtol=1e-9, atol=1e-10), name
        assert result["dofs"] == expected["dofs"]


def test_refused():
    for cell in ("hexahedron", "quadrilateral"):
        with pytest.raises(ValueError, match=r"--cell.*tetrahedron or triangle"):
            newtonian(cell=cell)
    with pytest.raises(ValueError, match="--overhang"):
        newtonian(overhang=0.3)
    with pytest.raises(ValueError, match=r"--material.*elastic, newtonian"):
        Parameters(material="plastic")
    assert tuple(MATERIALS) == ("elastic", "newtonian")


def test_refused_on_the_command_line(capsys, monkeypatch):
    arguments = ["patch_test.py", "--material", "newtonian", "--cell", "hexahedron"]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit) as stopped:
        patch_test.main()
    assert stopped.value.code == 2
    assert "--cell: " in capsys.readouterr().err


@pytest.mark.parametrize("material", MATERIALS)
def test_keys(material):
    """The JSON file has the keys that other checks use."""
    result, _ = run(Parameters(3, 2, material=material))
    assert list(result) == [
        "formulation",
        "load",
        "cell",
        "n_master",
        "n_slave",
        "dofs",
        "penalty",
        "slave_mean_error",
        "slave_max_error",
        "master_mean_error",
        "master_max_error",
        "slave_nodal_max_error",
        "master_nodal_max_error",
        "gap_max",
        "snes_iterations",
        "ksp_iterations",
        "force_imbalance",
        "contact_seconds",
        "total_seconds",
    ]
