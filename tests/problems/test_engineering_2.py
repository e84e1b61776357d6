"""Scripts of demos/engineering at the smallest size: each keeps the limits that it prints."""

import json

import bracket
import numpy as np
import pytest
import roller_on_rubber
import stl_forging
import three_bodies
from common.limits import check
from project import pages
from scenes import WORLD
from stl_forging_die import HEIGHT, profile, write_stl

import qsdolfinx as qs


def check_picture(tmp_path, draw, *what):
    """Check that a legible picture can be drawn, if matplotlib is installed. Collective."""
    pytest.importorskip("matplotlib")
    filename = WORLD.bcast(tmp_path / "picture.png")
    draw(filename, *what)
    WORLD.barrier()
    with pytest.importorskip("PIL.Image").open(filename) as picture:
        width, height = picture.size
        pixels = np.asarray(picture.convert("L"))
    assert 800 <= width <= 1800 and 300 <= height <= 1500
    assert 0.02 < np.mean(pixels < 200) < 0.7


@pytest.mark.long
def test_roller_on_rubber(tmp_path):
    """The roller travels by the length of rubber that passes its rim, and by less than its rim."""
    result, rows, scene = roller_on_rubber.run(roller_on_rubber.Parameters(4.0, 48.0), WORLD)
    check(result, roller_on_rubber.LIMITS)
    assert 1.05 < result["stretch"] < 1.2
    ways = [row["way"] for row in rows if row["angle"] > 0]
    assert np.all(np.diff(ways) > 0)
    published = roller_on_rubber.PUBLISHED
    check_picture(tmp_path, roller_on_rubber.draw, result, rows, scene, published)


@pytest.mark.long
def test_bracket(tmp_path):
    """A tied bracket has the same stress as one in one mesh, with fewer unknowns."""
    result, *bodies = bracket.run(bracket.Parameters(2.0, 5.0), WORLD)
    check(result, bracket.LIMITS)
    assert result["dofs"] < 0.8 * result["dofs_matching"]
    assert 1.5 < result["concentration"] < 2.5
    check_picture(tmp_path, bracket.draw, result, *bodies)


def test_stl_forging(tmp_path):
    """Volume, forces and energies balance; the billet flows up into the pocket."""
    picture = stl_forging.Picture()
    result, rows = stl_forging.run(stl_forging.Parameters(3.0, 12, 2 / 3), WORLD, picture)
    check(result, stl_forging.LIMITS)
    assert result["boss"] > 0.5 * rows[-1]["stroke"]
    check_picture(tmp_path, picture.draw, rows)


def test_stl_file(tmp_path):
    """The die that is read has the shape of the profile, and faces the billet."""
    filename = WORLD.bcast(tmp_path / "die.stl")
    if WORLD.rank == 0:
        write_stl(filename, rings=10, sectors=7)
    die = qs.RigidSurface.from_stl(WORLD, filename)
    facet = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    x = np.fromfile(filename, facet, offset=84)["corners"].astype(float)
    WORLD.barrier()
    r = np.hypot(x[..., 0], x[..., 1])
    np.testing.assert_allclose(x[..., 2], HEIGHT + profile(r), atol=1e-5)
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    assert np.all(normal[:, 2] < 0)
    # Nine fans of rings over six sectors; a ring at the axis has one triangle per sector.
    assert len(x) == 6 * (2 * 9 - 1)
    edges = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    np.testing.assert_allclose(die.facet_size_range, (edges.min(), edges.max()), rtol=1e-5)


def test_three_bodies(tmp_path):
    """Bars act in series, Coulomb's law holds, forces balance; a restart continues the same run."""
    picture = three_bodies.Picture()
    result, rows, again = three_bodies.run(three_bodies.Parameters(3, 2), WORLD, picture)
    check(result, three_bodies.LIMITS)
    assert (len(rows), len(again)) == (6, 2)
    check_picture(tmp_path, picture.draw, rows, again)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_pad_that_friction_alone_holds(monkeypatch, sliding):
    """A step that draws the plate by a quarter of the pad's height converges to slip.

    The pad, which friction alone holds, sticks at first. Newton's step then lets it slip on both
    sides: it is limited to the range in which forces do work, and does not move by thousands of
    millimetres or off the pier.
    """
    make = qs.Contact
    monkeypatch.setattr(qs, "Contact", lambda *a, **k: make(*a, sliding=sliding, **k))
    _, contacts, stepper = three_bodies.build(WORLD, three_bodies.Parameters(3, 2))
    for _ in range(3):
        stepper.step()
    assert stepper.num_cutbacks == 0 and stepper.num_iterations <= 15  # 41, and lost before
    force = contacts["plate"].force("slave")
    np.testing.assert_allclose(force[0] / -force[2], three_bodies.MU["plate"], rtol=1e-4)


def test_three_bodies_restarted(tmp_path, monkeypatch, capsys):
    """From the command line, files for ParaView are written, and a second program continues."""
    folder = WORLD.bcast(tmp_path)
    words = ["three_bodies", "--cells", "2", "--steps", "1", "--output", str(folder / "run")]
    json_file = folder / "result.json"
    for more in ([], ["--restart", "--json", str(json_file)]):
        monkeypatch.setattr("sys.argv", [*words, *more])
        three_bodies.main()
        WORLD.barrier()
    names = {path.name for path in (folder / "run").iterdir()}
    assert {"pier.xdmf", "pad.xdmf", "plate.xdmf", "history.csv", "checkpoint"} <= names
    assert abs(json.loads(json_file.read_text())["restart_error"]) < 1e-9
    with pytest.raises(ValueError, match="--restart needs the --output"):
        three_bodies.Parameters(restart=True)


def test_roller_needs_an_angle():
    with pytest.raises(ValueError, match="--degrees: must be at least 20"):
        roller_on_rubber.Parameters(degrees=4.0)


@pytest.mark.parametrize("name", ("bracket", "roller_on_rubber", "stl_forging", "three_bodies"))
def test_size(name):
    """Each script is short, and has a page and a small picture."""
    script = pages.ROOT / f"demos/engineering/{name}.py"
    assert script.read_text(encoding="utf-8").count("\n") <= 120
    page = (pages.ROOT / f"docs/howto/{name}.md").read_text(encoding="utf-8")
    assert f"demos/engineering/{name}.py" in page and f"../figures/{name}.png" in page
    assert (pages.ROOT / f"docs/figures/{name}.png").stat().st_size < 150e3
