"""The meshes and inputs that bench/peers.py gives to other programs."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "bench" / "peers"))

import calculix
import cubes
import install


@pytest.mark.parametrize("bottom", [0.0, 1.0])
def test_cube(bottom):
    """Cells have the same positive volume, faces look outward and belong to the cells named."""
    n = 3
    body = cubes.cube(n, bottom)
    assert body.x.shape == ((n + 1) ** 3, 3) and body.cells.shape == (n**3, 8)
    corner = body.x[body.cells]
    edges = np.stack([corner[:, k] - corner[:, 0] for k in (1, 3, 4)], axis=1)
    assert np.allclose(np.linalg.det(edges), n**-3.0)
    assert np.allclose(corner[:, 6] - corner[:, 0], edges.sum(axis=1))
    for quads, cells, z, up in (
        (body.low, body.low_cells, bottom, -1),
        (body.high, body.high_cells, bottom + 1, 1),
    ):
        x = body.x[quads]
        normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) / 2
        assert np.allclose(normal, [0, 0, up / n**2]) and np.allclose(x[:, :, 2], z)
        side = body.cells[cells, :4] if up < 0 else body.cells[cells, 4:]
        assert np.array_equal(np.sort(side, axis=1), np.sort(quads, axis=1))


def test_calculix_input(tmp_path):
    """Nodes and cells are numbered on from one cube to the other, faces are those that touch."""
    calculix.write_deck(tmp_path / "job.inp", [3, 2], 5.0, "SPOOLES", "B")
    text = (tmp_path / "job.inp").read_text()
    cards = {}
    for block in text.split("\n*"):
        head, *rows = block.strip("*").split("\n")
        cards.setdefault(head, []).append([r for r in rows if r])
    nodes = [row.split(",") for part in cards["NODE"] for row in part]
    assert [int(r[0]) for r in nodes] == list(range(1, 64 + 27 + 1))
    z = {int(r[0]): float(r[3]) for r in nodes}
    cells = {}
    for name in "AB":
        for row in cards[f"ELEMENT, TYPE=C3D8, ELSET={name}"][0]:
            number, *its_nodes = map(int, row.split(","))
            cells[number] = its_nodes
    assert list(cells) == list(range(1, 27 + 8 + 1))
    for name, count in (("A", 9), ("B", 4)):
        faces = [row.split(", ") for row in cards[f"SURFACE, NAME=FACE{name}, TYPE=ELEMENT"][0]]
        assert len(faces) == count
        for number, side in faces:
            on_face = cells[int(number)][4:] if side == "S2" else cells[int(number)][:4]
            assert all(z[k] == 1.0 for k in on_face)
        held = [int(row) for row in cards[f"NSET, NSET=HELD{name}"][0]]
        assert {z[k] for k in held} == {0.0 if name == "A" else 2.0}


def test_missing_program():
    """What cannot be started is reported with the reason."""
    found = install.prepare(["kratos"], None, "/nowhere/python3", lambda text: None)
    assert isinstance(found["kratos"], install.Missing)
    assert "No such file" in str(found["kratos"])


def test_missing_solver(tmp_path):
    """A program that ends with an error gives its message, not numbers."""
    program = tmp_path / "ccx"
    program.write_text("#!/bin/sh\necho ' *ERROR: the solver is not linked'\nexit 201\n")
    program.chmod(0o755)
    command = [sys.executable, calculix.__file__, "--sizes", "2,1", "--ccx", program]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode != 0 and "not linked" in done.stderr
    assert "RESULT" not in done.stdout
