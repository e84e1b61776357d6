"""Meshes and inputs that bench/peers.py gives to other programs."""

import importlib.util
import os
import pathlib
import subprocess
import sys

from mpi4py import MPI

import numpy as np
import pytest

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "bench" / "peers"))

import calculix
import cubes
import hertz_error
import install
import ours
import ring
import sphere
import spring


@pytest.mark.parametrize("bottom", [0.0, 1.0])
def test_cube(bottom):
    """Cells have equal positive volumes; faces point outward and belong to the named cells."""
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


@pytest.mark.parametrize("refine", [1, 2])
def test_ring(refine):
    """Cells have the same orientation; edges that may touch have the body on their left."""
    areas = {"ring": np.pi / 2 * (ring.OUTER**2 - ring.INNER**2), "block": ring.WIDTH * ring.HEIGHT}
    for name, body in ring.bodies(refine).items():
        a, b, c, d = body.x[body.cells].transpose(1, 0, 2)
        diagonals = np.stack([c - a, d - b], axis=1)
        area = np.linalg.det(diagonals) / 2
        assert area.min() > 0 and np.isclose(area.sum(), areas[name], rtol=1e-3)
        sides = {(i, j) for k in range(4) for i, j in np.roll(body.cells, k, axis=1)[:, :2]}
        for i, j in body.touching:
            assert (i, j) in sides and (j, i) not in sides
        mirrored = body.x * [-1, 1]
        assert np.array_equal(np.unique(mirrored + 0.0, axis=0), np.unique(body.x + 0.0, axis=0))
    x, block = ring.ring(refine), ring.block(refine)
    assert np.array_equal(x.x[x.tracked["ring_outside"]], [0, 0])
    assert np.allclose(block.x[block.tracked["block_left"]], [-0.5, 0])
    assert ring.path()[-1] == (ring.ALONG, -ring.DOWN)


@pytest.mark.parametrize("refine", [1, 2])
def test_spring(refine):
    """The spring is one body without holes; its halves and its ends are distinguished."""
    body = spring.spring(refine)
    a, b, c, d = body.x[body.cells].transpose(1, 0, 2)
    area = np.linalg.det(np.stack([c - a, d - b], axis=1)) / 2
    arc = np.pi / 2 * ((spring.INNER + spring.THICK) ** 2 - spring.INNER**2)
    assert area.min() > 0
    assert np.isclose(area.sum(), arc + 2 * spring.LENGTH * spring.THICK, rtol=2e-3)
    sides = {(i, j) for k in range(4) for i, j in np.roll(body.cells, k, axis=1)[:, :2]}
    for i, j in body.touching:
        assert (i, j) in sides and (j, i) not in sides
    assert np.array_equal(np.concatenate([body.half(s) for s in (-1, 1)]), body.touching)
    assert np.all(body.x[body.held, 0] == spring.LENGTH)
    assert body.x[body.moved, 1].min() > 0 > body.x[body.fixed, 1].max()
    assert np.allclose(body.x[body.tracked["back"]], [-spring.INNER, 0])


def test_calculix_input(tmp_path):
    """Nodes and cells are numbered continuously over both cubes; faces are those in contact."""
    calculix.write_deck(tmp_path / "job.inp", cubes, [3, 2], 5.0, "SPOOLES", "B")
    text = (tmp_path / "job.inp").read_text()
    cards = {}
    for block in text.split("\n*"):
        head, *rows = block.strip("*").split("\n")
        cards.setdefault(head, []).append([r for r in rows if r])
    nodes = [row.split(",") for part in cards["NODE, NSET=ALL"] for row in part]
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


def test_calculix_symmetry(tmp_path):
    """Nodes on symmetry planes are fixed along the normal of the plane."""
    calculix.write_deck(tmp_path / "job.inp", sphere, [3, 2], 5.0, "SPOOLES", "B", True)
    cards = (tmp_path / "job.inp").read_text().split("\n*")
    held = next(card for card in cards if card.startswith("BOUNDARY")).split("\n")
    first = 1
    for name, body in zip("AB", sphere.bodies([3, 2]), strict=True):
        for axis in (0, 1):
            assert f"PLANE{axis}{name}, {axis + 1}, {axis + 1}" in held
            head = f"NSET, NSET=PLANE{axis}{name}\n"
            nodes = next(card for card in cards if card.startswith(head)).split()[2:]
            expected = np.flatnonzero(body.x[:, axis] == 0) + first
            assert [int(k) for k in nodes] == expected.tolist()
        first += len(body.x)
    assert cards[-2].startswith("NODE PRINT, NSET=ALL\nU")


def test_calculix_displacements():
    """Of output in several increments, the last is used."""
    text = """
 displacements (vx,vy,vz) for set ALL and time  0.5000000E+00

         1  1.000000E-01 -2.000000E-05  0.000000E+00
         2  3.000000E-01  4.000000E+00 -5.000000E-11

 forces (fx,fy,fz) for set HELDA and time  0.5000000E+00

         7.000000E+00  8.000000E+00  9.000000E+00
"""
    later = text.replace("0.5000000E+00", "1.0000000E+00").replace("3.0000", "6.0000")
    assert calculix.read_displacements(text + later) == [[0.1, -2e-5, 0.0], [0.6, 4.0, -5e-11]]
    assert calculix.read_displacements("") is None


def test_missing_program():
    """A program that cannot be started is reported with the reason."""
    found = install.prepare(["kratos"], None, "/nowhere/python3", lambda text: None)
    assert isinstance(found["kratos"], install.Missing)
    assert "No such file" in str(found["kratos"])


def test_missing_package():
    """A package that Python does not find, and that is not to be installed, is reported as well."""
    if importlib.util.find_spec("dolfinx_contact"):
        pytest.skip("it is there")
    found = install.prepare(["asimov"], None, None, lambda text: None)
    assert isinstance(found["asimov"], install.Missing)
    assert "dolfinx_contact" in str(found["asimov"])


@pytest.mark.one_rank
def test_no_source(monkeypatch, tmp_path):
    """Without git, the error names the repository to clone, and the option for its folder."""
    if importlib.util.find_spec("dolfinx_contact"):
        pytest.skip("it is there")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(install.Missing, match=r"git clone .* v0.9.0 .*--asimov-source"):
        install.asimov(tmp_path / "peers", None)


def test_python_path(monkeypatch):
    """A folder of packages is put before the existing path, and nothing else changes."""
    monkeypatch.setenv("PYTHONPATH", "/some")
    assert install.with_path("/other")["PYTHONPATH"] == os.pathsep.join(("/other", "/some"))
    assert install.with_path(None)["PYTHONPATH"] == "/some"


def test_missing_solver(tmp_path):
    """If a program ends with an error, its message is reported, not numbers."""
    program = tmp_path / "ccx"
    program.write_text("#!/bin/sh\necho ' *ERROR: the solver is not linked'\nexit 201\n")
    program.chmod(0o755)
    command = [sys.executable, calculix.__file__, "--sizes", "2,1", "--ccx", program]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode != 0 and "not linked" in done.stderr
    assert "RESULT" not in done.stdout


# --- Hertz


def test_sphere_mesh():
    """The job "hertz" has the right volumes, contact surfaces and symmetry planes."""
    sizes = 9, 6
    lower, upper = sphere.bodies(sizes)
    side = sphere.SIDE
    for body, n in zip((lower, upper), sizes, strict=True):
        assert body.x.shape == ((n + 1) ** 3, 3) and body.cells.shape == (n**3, 8)
        x = body.x
        first = np.unique(x[:, 0])[1]
        assert np.isclose(first, sphere.cell_size(n)) and np.isclose(x[:, :2].max(), side)
        for axis, quads in body.planes.items():
            assert np.array_equal(np.unique(quads), np.flatnonzero(x[:, axis] == 0))
            a, b, c, d = (x[quads[:, k]] for k in range(4))
            normal = np.cross(c - a, d - b)
            assert (normal[:, axis] < 0).all()
            assert np.allclose(np.delete(normal, axis, axis=1), 0)
            outer = side**2 - (0 if body is lower else side**3 / (6 * sphere.R))
            area = -normal[:, axis].sum() / 2
            # Chords of the parabola are above it.
            assert outer * 0.99 < area < outer * (1 + 1e-12)
    low, high = lower.x[np.unique(lower.high)], upper.x[np.unique(upper.low)]
    assert np.all(low[:, 2] == 0)
    assert np.allclose(high[:, 2], np.sum(high[:, :2] ** 2, axis=1) / (2 * sphere.R))
    assert np.all(lower.x[np.unique(lower.low), 2] == -side)
    assert np.allclose(upper.x[np.unique(upper.high), 2], side)
    under = hertz_error.areas(upper.x, upper.low) @ upper.x[:, 2]
    assert np.isclose(volume(lower), side**3) and np.isclose(volume(upper), side**3 - under)


def volume(body):
    """Volume from six tetrahedra around a diagonal of each cell; faces of cells are planar."""
    paths = [(1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1)]
    x = body.x[body.cells]
    parts = [
        np.linalg.det(np.stack([x[:, k] - x[:, 0] for k in (i, j, 6)], axis=1)) for i, j in paths
    ]
    assert np.min(parts) > 0
    return np.sum(parts) / 6


def test_uniform_pressure():
    """A uniform vertical stress gives the exact pressure at all nodes, and no other forces."""
    stress = -7.0
    lower, upper = sphere.bodies([7, 5])
    for body, modulus, quads, sign in (
        (lower, sphere.E[0], lower.high, -1),
        (upper, sphere.E[1], upper.low, 1),
    ):
        u = body.x * [-sphere.NU, -sphere.NU, 1] * stress / modulus
        forces = hertz_error.internal_forces(body, u, modulus, sphere.NU)
        nodes, area = np.unique(quads), hertz_error.areas(body.x, quads)
        assert np.isclose(area.sum(), sphere.SIDE**2)
        assert np.allclose(sign * forces[nodes, 2] / area[nodes], -stress)
        assert hertz_error.unbalanced(body, forces) < 1e-10 * abs(stress)


def test_hertz_forces():
    """Nodal forces of Hertz's pressure have its sum and moments; their error is that of lumping."""
    force, nodal = 150.0, []
    a, p0 = hertz_error.hertz(force)
    for sizes in ((13, 10), (27, 21)):
        lower, upper = sphere.bodies(sizes)
        for body, quads in ((lower, lower.high), (upper, upper.low)):
            f = hertz_error.hertz_forces(body.x, quads, force)
            assert np.isclose(f.sum(), force / 4, rtol=1e-4)
            moment = p0 * a**3 * np.pi / 16
            assert np.allclose(f @ body.x[:, :2], moment, rtol=1e-4)
            lumped, at_nodes = hertz_error.relative_errors(body.x, quads, f, force)
            assert lumped == 0
            nodal.append(at_nodes)
            assert np.isclose(hertz_error.relative_errors(body.x, quads, 1.1 * f, force)[0], 0.1)
    assert nodal[0] < 0.08 and nodal[2] < 0.6 * nodal[0]


def test_wrong_conditions():
    """Displacements that violate the conditions of the job give a reason, not an error measure."""
    sizes = 4, 3
    bodies = sphere.bodies(sizes)
    u = np.zeros((sum(len(body.x) for body in bodies), 3))
    with pytest.raises(ValueError, match="conditions"):
        hertz_error.measure(sizes, u)
    u[len(bodies[0].x) :, 2] = sphere.PRESS
    with pytest.raises(ValueError, match="no contact force"):
        hertz_error.measure(sizes, u)
    u[np.unique(bodies[0].planes[1])[-1], 1] = np.nan
    with pytest.raises(ValueError, match="conditions"):
        hertz_error.measure(sizes, u)


def test_own_forces():
    """A program's tractions are measured instead of internal forces; its loads balance those."""
    sizes, force = (7, 5), 150.0
    lower, upper = sphere.bodies(sizes)
    first = len(lower.x)
    u = np.zeros((first + len(upper.x), 3))
    u[first + np.unique(upper.high), 2] = sphere.PRESS
    tractions = np.zeros_like(u)
    tractions[:first, 2] = -hertz_error.hertz_forces(lower.x, lower.high, force)
    tractions[first:, 2] = hertz_error.hertz_forces(upper.x, upper.low, force)
    inside = [
        hertz_error.internal_forces(body, part, modulus, sphere.NU)
        for body, part, modulus in zip((lower, upper), np.split(u, [first]), sphere.E, strict=True)
    ]
    row = hertz_error.measure(sizes, u, tractions=tractions)
    assert np.isclose(row["total"], force, rtol=1e-3)
    assert row["unbalanced_upper"] > 1e-3  # only the top is displaced
    row = hertz_error.measure(sizes, u, np.concatenate(inside), 1.1 * tractions)
    assert row["unbalanced_lower"] == row["unbalanced_upper"] == 0
    assert np.isclose(row["total"], 1.1 * force, rtol=1e-3)
    far = hertz_error.measure(sizes, u, tractions=2 * tractions)
    assert far["l2_lower"] > row["l2_lower"] > 1e-2  # a larger force has another radius


@pytest.mark.one_rank
def test_asimov_converges(monkeypatch):
    """Nitsche's tractions converge to Hertz's pressure, and its forces balance internal forces."""
    pytest.importorskip("dolfinx_contact")
    import asimov

    monkeypatch.setattr(asimov, "COMM", MPI.COMM_SELF)
    rows = []
    for sizes in ((10, 8), (20, 16)):
        p = asimov.arguments().parse_args(["--job", "hertz", "--sizes", "0,0", "--linear", "icc"])
        p.job, p.sizes = sphere, sizes
        u, contact, row = asimov.solve(p)
        rows.append(hertz_error.measure(sizes, u, **contact))
        assert np.isclose(4 * row["force"], rows[-1]["total"], rtol=1e-6)
        assert np.isclose(rows[-1]["radius"], 1, atol=0.02)
    for name in ("lower", "upper"):
        coarse, fine = (row[f"l2_{name}"] for row in rows)
        assert fine < 0.035 and fine < 0.8 * coarse
        assert rows[1][f"unbalanced_{name}"] < 1e-8


@pytest.mark.one_rank
def test_asimov_cubes(monkeypatch):
    """The force of the cubes is that of our augmented Lagrangian, which leaves no gap either."""
    pytest.importorskip("dolfinx_contact")
    import asimov

    sizes = 8, 6
    monkeypatch.setattr(asimov, "COMM", MPI.COMM_SELF)
    monkeypatch.setattr(ours, "COMM", MPI.COMM_SELF)
    p = asimov.arguments().parse_args(["--sizes", "0,0", "--linear", "mumps"])
    p.job, p.sizes = cubes, sizes
    force = asimov.solve(p)[2]["force"]
    expected = ours.solve(ours.arguments().parse_args(["--sizes", "0,0"]), cubes, sizes)[1]["force"]
    assert np.isclose(force, expected, rtol=1e-4)


@pytest.mark.one_rank
@pytest.mark.long
def test_ours_converges(monkeypatch):
    """The pressure of our own solution converges to Hertz's, on both bodies."""
    monkeypatch.setattr(ours, "COMM", MPI.COMM_SELF)
    rows = []
    for sizes in ((10, 8), (20, 16)):
        p = ours.arguments().parse_args(["--job", "hertz", "--sizes", "0,0"])
        u, row = ours.solve(p, sphere, sizes)
        rows.append(hertz_error.measure(sizes, u))
        assert np.isclose(4 * row["force"], rows[-1]["total"], rtol=1e-6)
        assert np.isclose(rows[-1]["radius"], 1, atol=0.02)
    for name in ("lower", "upper"):
        coarse, fine = (row[f"l2_{name}"] for row in rows)
        assert fine < 0.055 and fine < 0.6 * coarse
        assert rows[1][f"unbalanced_{name}"] < 1e-8
