"""Pictures of the demos: each demo draws its own, on any number of ranks."""

import ast
import importlib
import itertools
import pathlib
import re
import sys

import numpy as np
import pytest
from scenes import WORLD, box

from dolfinx import fem

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")

from common import drawing  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
LARGEST = 150e3  # bytes of a picture in docs/figures
#: Arguments with which each demo ends within a second or two.
SMALL = {
    "block_on_block": ["--push", "1.2e-2"],
    "cattaneo_mindlin": ["--h", "0.2"],
    "curved_beams": ["--cells", "2", "--steps", "16"],
    "rubber": ["--facet", "0.4", "--steps", "12", "--distance", "0.1"],
    "fold": ["--cells", "1", "--steps", "32"],
    "closed_die": ["--size", "4.5", "--tool-size", "3", "--advance", "1.5", "--stroke", "1.5"],
    "hertz": ["--h", "0.4"],
    "hertz --dim 3": ["--h", "0.6"],
    "ironing": ["--h", "0.3", "--steps", "42"],
    "patch_test": ["--master", "2", "--slave", "2"],
    "ring_compression": ["--cells", "3", "--steps", "1", "--reduction", "0.05"],
    "shaft": ["--facets", "24", "--interference", "0.03", "--steps", "1"],
    "sliding_wedge": ["--mu", "0.1"],
    "upset_cylinder": ["--steps", "2", "--reduction", "0.1"],
    "upset_cylinder --dim 3": ["--steps", "1", "--reduction", "0.05"],
    "upsetting_convergence": ["--levels", "2"],
    "forging_plot": ["--die-refinement", "1", "--steps", "1", "--reduction", "0.02"],
}
FORGING = ["--die-refinement", "1", "--steps", "2", "--reduction", "0.04"]


def draw(monkeypatch, name, arguments):
    """Run a demo as from the command line."""
    program, *more = name.split()
    monkeypatch.setattr(sys, "argv", [program, *more, *arguments])
    importlib.import_module(program).main()
    WORLD.barrier()


def shared(tmp_path, name):
    """A file name that is the same on all ranks."""
    return WORLD.bcast(str(tmp_path / name))


def check_picture(frame):
    """Check that a picture has a legible size, white background, and some content."""
    pixels = np.asarray(frame.convert("RGB"))
    height, width, _ = pixels.shape
    assert 300 <= height <= 1500 and 800 <= width <= 1800
    drawn = np.mean(pixels.min(axis=2) < 200)
    assert 0.01 < drawn < 0.7
    assert np.mean(pixels.min(axis=2) > 250) > 0.1


#: Demos whose pictures are tested after each change: a mesh, curves, a 3D body, a table.
EACH_TIME = ("patch_test", "hertz", "sliding_wedge", "ironing")


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in EACH_TIME else pytest.mark.long) for n in SMALL],
)
def test_picture(monkeypatch, tmp_path, capsys, name):
    if name == "closed_die":
        pytest.importorskip("gmsh")
    filename = shared(tmp_path, "picture.png")
    option = [] if name == "forging_plot" else ["--plot"]
    draw(monkeypatch, name, [*SMALL[name], *option, filename])
    with Image.open(filename) as picture:
        check_picture(picture)
    assert pathlib.Path(filename).stat().st_size < LARGEST


def test_forging_animated(monkeypatch, tmp_path, capsys):
    """The animation has one frame at first and one per step; the last frame is the picture."""
    names = [shared(tmp_path, f"forging.{kind}") for kind in ("png", "gif")]
    draw(monkeypatch, "forging", [*FORGING, "--plot", names[0], "--animate", names[1]])
    with Image.open(names[0]) as picture, Image.open(names[1]) as film:
        check_picture(picture)
        assert film.n_frames >= 3
        frames = []
        for i in range(3):
            film.seek(i)
            check_picture(film)
            frames.append(np.asarray(film.convert("RGB"), dtype=float))
    assert all(np.abs(a - b).mean() > 0.1 for a, b in itertools.pairwise(frames))


def test_every_demo_has_plot():
    """--plot is an option of every program among the demos."""
    programs = [
        path.stem
        for path in (ROOT / "demos").glob("*.py")
        if "__main__" in path.read_text(encoding="utf-8") and path.stem != "forging_plot"
    ]
    assert len(programs) >= 10
    tried = {name.split()[0] for name in SMALL} - {"forging_plot"} | {"forging"}
    assert set(programs) == tried
    for name in programs:
        assert "plot=" in (ROOT / f"demos/{name}.py").read_text(encoding="utf-8"), name


@pytest.mark.parametrize("path", sorted((ROOT / "demos/common").glob("*.py")), ids=lambda p: p.stem)
def test_imports_no_demo(path):
    """Demos import the module of pictures, and not the other way round."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    names |= {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    assert [name for name in names if (ROOT / f"demos/{name}.py").exists()] == []


@pytest.mark.parametrize("name", ("hertz", "forging", "ring_compression"))
def test_refused(monkeypatch, tmp_path, capsys, name):
    """Unknown file types, and missing matplotlib, are refused before the demo computes."""

    def said(filename):
        with pytest.raises(SystemExit) as stopped:
            draw(monkeypatch, name, ["--plot", filename])
        assert stopped.value.code == 2
        return capsys.readouterr().err

    assert "must end in" in said(str(tmp_path / "picture.xyz"))
    monkeypatch.setitem(sys.modules, "matplotlib.backend_bases", None)
    assert "need matplotlib" in said(str(tmp_path / "picture.png"))


# --- Gathered data


@pytest.mark.parametrize("kind, number", (("triangle", 12), ("quadrilateral", 6)))
def test_cells(kind, number):
    """All cells are gathered once: areas and the integral of a linear function are right.

    The mesh has moved.
    """
    msh = box(WORLD, (3, 2), kind, [0.0, 0.0], [2.0, 1.0])
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: (0.5 * x[0] + x[1], 2 * x[1]))
    moved = drawing.node_values(u)
    drawn = drawing.cells(msh, moved, u[0].dx(0) * u[1])  # y
    expected = msh.geometry.x[:, :1] * [0.5, 0] + msh.geometry.x[:, 1:2] * [1, 2]
    np.testing.assert_allclose(moved, expected, atol=1e-14)
    assert (drawn is None) == (WORLD.rank > 0)
    if drawn is not None:
        corners, values = drawn
        x, y = np.moveaxis(corners, -1, 0)
        areas = np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1) / 2
        assert len(areas) == number
        assert np.isclose(np.abs(areas).sum(), 2 * 1.5 * 3)
        assert np.isclose(np.abs(areas) @ values, 4.5)  # 9 times the mean of y, 1/2


def test_boundary():
    """The boundary is closed with outward normals: volume by the divergence theorem."""
    msh = box(WORLD, (3, 2, 2), "tetrahedron", [0.0, 0.0, 1.0], [1.0, 2.0, 4.0])
    x = msh.geometry.x.copy()
    x[:, 0] += 0.3 * x[:, 2]  # sheared: the same volume
    nodes, cells = drawing.boundary(msh, x)
    surface = drawing.gather(WORLD, x[nodes])
    index_map = msh.topology.index_map(3)
    assert np.all(cells < index_map.size_local + index_map.num_ghosts)
    assert (surface is None) == (WORLD.rank > 0)
    if surface is not None:
        (corners,) = surface
        assert len(corners) == 2 * 2 * (3 * 2 + 3 * 2 + 2 * 2)
        assert np.isclose(np.linalg.det(corners).sum() / 6, 1 * 2 * 3)


# --- The gallery


def test_gallery():
    """Pictures exist and are small, and a command makes each of them."""
    text = (ROOT / "docs/gallery.md").read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]+\]\((figures/[\w.]+)\)", text)
    command = r"^    (?:mpirun -n 2 )?python3 demos/"
    made = re.findall(command + r".*?docs/(figures/\S+)", text, re.MULTILINE)
    made += re.findall(command + r".*--animate docs/(figures/\S+)", text, re.MULTILINE)
    assert len(shown) >= 11
    assert set(shown) == set(made)
    for name in shown:
        size = (ROOT / "docs" / name).stat().st_size
        assert size < (1.5e6 if name.endswith(".gif") else LARGEST), name
