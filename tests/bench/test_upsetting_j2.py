"""The elasto-plastic billet of bench/upsetting_j2.py, coarse, and its input for CalculiX."""

import pathlib
import re
import sys

import numpy as np
import pytest

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "bench"))
sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "bench" / "peers"))

import upsetting_calculix
import upsetting_j2


@pytest.fixture(scope="module")
def history():
    """Run a coarse billet; returns its history."""
    return upsetting_j2.run(4, 12, verbose=False)


def test_force_and_energy(history):
    """The force is between about that without friction and Siebel's; energies add up."""
    rows = upsetting_j2.table(history)
    assert np.isclose(history["reduction"][-1], 0.6)
    for row in rows:
        lower = 0.95 * row["frictionless"]  # the face is smaller than the section
        assert lower < row["force"] < row["siebel"], row
        assert abs(row["energy_error"]) < 0.02 and abs(row["volume_change"]) < 0.005, row
    assert np.all(np.diff([row["radius"] for row in rows]) > 0.5)
    # Compared with a cylinder of the same volume, it is thinner at the die and wider in the middle.
    assert rows[-1]["die_radius"] < 10 / np.sqrt(0.4) < rows[-1]["radius"]


def test_first_step(history):
    """Before yielding, it is stiffer than a free bar and softer than a laterally confined one."""
    stress = history["force"][1] / (np.pi * 10**2) / history["reduction"][1]
    assert 200e3 < stress < 200e3 * (1 - 0.3) / (1 + 0.3) / (1 - 2 * 0.3)


def test_deck():
    """Elements have one orientation and fill the section; the last ones of rows form the side."""
    parts = re.split(r"\n?\*(?=[A-Z])", upsetting_calculix.deck(4))
    blocks = {part.split("\n")[0]: part.split("\n")[1:] for part in parts}
    nodes = np.array([[float(v) for v in row.split(",")] for row in blocks["NODE"]])
    cells = np.array(
        [[int(v) for v in row.split(",")] for row in blocks["ELEMENT, TYPE=CAX8R, ELSET=BILLET"]]
    )
    x = nodes[:, 1:3]
    a, b, c, d, *middles = x[cells[:, 1:] - 1].transpose(1, 0, 2)
    assert np.isclose(np.linalg.det(np.stack([c - a, d - b], axis=1)).sum() / 2, 150)
    pairs = ((a, b), (b, c), (c, d), (d, a))
    for middle, (p, q) in zip(middles, pairs, strict=True):
        assert np.allclose(middle, (p + q) / 2)
    side = [int(row.split(",")[0]) for row in blocks["SURFACE, NAME=SIDE, TYPE=ELEMENT"]]
    assert np.allclose(b[np.array(side) - 1, 0], 10) and len(side) == 6
