"""The patch test: known numbers, ratios of the formulations, same results on any partition."""

from mpi4py import MPI

import numpy as np
import patch_test
import pytest
from patch_bodies import E_MASTER
from patch_test import Parameters, run
from scenes import WORLD, spread_cells

PENALTY = 1e3 * E_MASTER

# An independent serial prototype (NumPy) gave, in %: stress error of the interface cells, slave
# mean and maximum, master mean and maximum, then the largest error of the nodal forces on each.
PROTOTYPE = {
    ("tetrahedron", 4, 3): {
        "master-slave": ("0.75", "2.36", "2.26", "7.46", "21", "59"),
        "quasi-symmetric": ("0.21", "0.43", "0.60", "1.22", "4.8", "10.7"),
        "double-pass": ("0.03", "0.06", "0.08", "0.19", "0.6", "1.8"),
    },
    ("tetrahedron", 3, 4): {
        "master-slave": ("0.37", "1.51", "1.27", "5.06", "25", "33"),
        "quasi-symmetric": ("0.20", "0.39", "0.51", "1.09", "4.7", "11.0"),
        "double-pass": ("0.03", "0.07", "0.06", "0.15", "0.8", "1.5"),
    },
    ("tetrahedron", 8, 3): {
        "master-slave": ("0.65", "2.55", "2.32", "12.4", "28", "606"),
        "quasi-symmetric": ("0.23", "0.93", "1.17", "6.52", "10.5", "296"),
        "double-pass": ("0.02", "0.07", "0.06", "0.29", "0.5", "16.9"),
    },
    ("hexahedron", 4, 3): {
        "master-slave": ("0.93", "2.01", "1.75", "3.95", "15", "54"),
        "quasi-symmetric": ("0.22", "0.46", "0.37", "0.85", "3.6", "13.2"),
        "double-pass": ("0.03", "0.06", "0.06", "0.14", "0.6", "2.3"),
    },
    ("hexahedron", 8, 3): {
        "master-slave": ("0.97", "1.99", "1.41", "3.20", "16", "512"),
        "quasi-symmetric": ("0.32", "0.63", "0.74", "1.66", "5.8", "266"),
        "double-pass": ("0.03", "0.09", "0.08", "0.19", "0.4", "6.5"),
    },
}
COLUMNS = ("slave_mean", "slave_max", "master_mean", "master_max", "slave_nodal_max")
COLUMNS = tuple(f"{name}_error" for name in (*COLUMNS, "master_nodal_max"))
ERRORS = ("slave_mean_error", "master_mean_error", "slave_max_error", "master_max_error")


@pytest.mark.parametrize("cell, master, slave", PROTOTYPE)
def test_prototype(cell, master, slave):
    """Results agree with every number of the prototype's table, to the digits given."""
    for formulation, expected in PROTOTYPE[cell, master, slave].items():
        p = Parameters(master, slave, cell, formulation=formulation, penalty=PENALTY)
        result, _ = run(p)
        for name, digits in zip(COLUMNS, expected, strict=True):
            places = len(digits.partition(".")[2])
            # One unit in the last digit: the prototype's own figures are rounded.
            found = 100 * result[name]
            assert abs(found - float(digits)) <= 0.5001 * 10**-places, (formulation, name, found)
        assert result["snes_iterations"] == 1
        assert result["force_imbalance"] < 1e-12


@pytest.mark.parametrize("jitter", (0.0, 0.25))
@pytest.mark.parametrize("load", ("pressure", "displacement"))
@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_quasi_symmetric_halves_the_error(cell, load, jitter):
    """Quasi-symmetric contact halves the error with a master finer than the slave."""
    for master, slave in ((5, 3), (5, 4), (6, 4), (9, 4), (9, 7)):
        results = [
            run(Parameters(master, slave, cell, jitter, 3, name, load, penalty=PENALTY))[0]
            for name in ("quasi-symmetric", "master-slave")
        ]
        for name in ERRORS:
            factor = 0.55 if "mean" in name else 0.7
            assert results[0][name] <= factor * results[1][name], (master, slave, name)


@pytest.mark.parametrize("formulation", ("master-slave", "double-pass", "quasi-symmetric"))
@pytest.mark.parametrize("cell", patch_test.CELLS)
def test_matching_meshes_are_exact(cell, formulation):
    p = Parameters(4, 4, cell, formulation=formulation, penalty=PENALTY)
    result, _ = run(p)
    for name in COLUMNS:
        assert result[name] < 1e-8
    # The displacement load includes the penalty's compliance.
    result, _ = run(Parameters(4, 4, cell, formulation=formulation, load="displacement"))
    for name in COLUMNS:
        assert result[name] < 1e-8
    assert np.isclose(result["gap_max"], 65 / result["penalty"], rtol=1e-8)


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_nested_meshes(cell):
    """If slave facets are within master facets (3 × 9), contact is exact.

    Only the compliance of the penalty remains.
    """
    result, _ = run(Parameters(3, 9, cell, formulation="master-slave", penalty=PENALTY))
    for name in ERRORS:
        assert result[name] < 1e-11
    # Quasi-symmetric contact needs a nonuniform multiplier here, hence a nonuniform gap λ/ε.
    soft, stiff = (run(Parameters(3, 9, cell, penalty=f * PENALTY))[0] for f in (1, 100))
    for name in ERRORS:
        assert stiff[name] < soft[name] / 50


@pytest.mark.parametrize("contact", ("tied", "unilateral"))
@pytest.mark.parametrize("cell", patch_test.CELLS)
def test_ranks_do_not_matter(cell, contact, monkeypatch):
    """All errors are as on one rank to 1e-9, with any distribution of the cells."""
    p = Parameters(5, 3, cell, 0.2, 1, load="displacement", contact=contact, penalty=PENALTY)
    expected, _ = run(p, MPI.COMM_SELF)
    results = [run(p)[0]]
    for partition in ("scattered", "last"):
        with spread_cells(monkeypatch, partition):
            results.append(run(p)[0])
    for result in results:
        for name in (*COLUMNS, "gap_max"):
            assert np.isclose(result[name], expected[name], rtol=1e-9, atol=0), name
        assert result["force_imbalance"] < 1e-12
        assert result["dofs"] == expected["dofs"]
        assert result["snes_iterations"] == expected["snes_iterations"]


def test_table(monkeypatch, capsys):
    """The table that the demo prints has the known numbers."""
    monkeypatch.setattr("sys.argv", ["patch_test.py"])
    patch_test.main()
    printed = capsys.readouterr().out
    if WORLD.rank == 0:
        assert printed.count("tetrahedron") == 17 and printed.count("hexahedron") == 8
        for number in ("3.600", "24.800", "5.300", "34.500", "overlay, here"):
            assert number in printed
        assert printed.count("one body") == 4
