"""MMG as the mesher: its input, the use of its output, and its failures."""

import importlib.metadata
import os
import pathlib

import numpy as np
import pytest
from forming_bodies import quarter_cylinder
from remeshing_scenes import Upset, all_nodes, area, bump, nodes_on, num_cells, tagged, volume
from scenes import WORLD

from dolfinx import mesh

import qsdolfinx as qs
from qsdolfinx.remeshing import mmg

pytest.importorskip("gmsh")

installed = pytest.mark.skipif(mmg.program() is None, reason="MMG is not installed")

#: A mesher that leaves the mesh as it is; {change} stands for other commands of it.
SAME = """#!/bin/sh
while [ $# -gt 1 ]; do
    if [ "$1" = -out ]; then out=$2; fi
    shift
done
{change}
"""


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Replace the program of MMG."""

    def put(change):
        path = tmp_path / "mmg3d"
        path.write_text(SAME.format(change=change))
        path.chmod(0o755)
        monkeypatch.setattr(mmg, "PROGRAMS", ("mmg3d",))
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    return put


def cylinder():
    """A quarter of a cylinder with a wavy surface, and tags of the planes."""
    msh = quarter_cylinder(WORLD, 10.0, 0.0, 6.0, 2.5)
    bump(msh, 0.2, 6.0)
    return msh, tagged(msh, [(0, 0.0), (1, 0.0), (2, 0.0)])


def corner(msh):
    """The node of the edge y = z = 0 that is farthest from the axis."""
    x = all_nodes(msh)
    on_edge = np.isclose(x[:, 1:], 0.0).all(axis=1)
    return x[on_edge][np.argmax(x[on_edge, 0])]


def test_a_mesh_that_stays_is_the_same_mesh(program):
    """A mesh that MMG leaves unchanged stays the same: nodes, cells, tags and boundary."""
    program('cp "$1" "$out"')
    msh, tags = cylinder()
    made = qs.remesh(msh, 2.5, tags, mesher="mmg")
    assert made.report.num_cells == made.report.old_cells == num_cells(msh)
    assert np.isclose(volume(made.mesh), volume(msh), rtol=1e-12)
    assert abs(made.report.unrestored) < 1e-9 and made.report.shift < 1e-8
    old = qs.Remeshed(msh, tags, None)
    for tag in (1, 2, 3):
        assert np.isclose(area(made, tag), area(old, tag), rtol=1e-9)
        assert np.all(nodes_on(made, tag)[:, tag - 1] == 0.0)
    first, second = all_nodes(msh), all_nodes(made.mesh)
    assert len(first) == len(second)
    apart = np.linalg.norm(first[:, None] - second[None], axis=2).min(axis=1)
    assert apart.max() < 1e-8


def test_nodes_off_the_old_boundary_are_put_on_it(program):
    """If a mesher shifts all nodes by 1e-3 along x, they are moved back to the old boundary.

    These are nodes at corners, and on lines, planes and the curved skin.
    """
    shifted = 'NF == 4 && $4 == 0 { printf "%.17g %s %s 0\\n", $1 + 1e-3, $2, $3; next }'
    program(f'awk \'{shifted} {{ print }}\' "$1" > "$out"')
    msh, tags = cylinder()
    made = qs.remesh(msh, 2.5, tags, mesher="mmg")
    assert np.isclose(volume(made.mesh), volume(msh), rtol=1e-12)
    for tag in (1, 2, 3):
        assert np.all(nodes_on(made, tag)[:, tag - 1] == 0.0)
    # Without moving them back, the skin would enclose 1e-4 more, with a shift of nodes by 4e-4.
    assert abs(made.report.unrestored) < 5e-5 and made.report.shift < 1e-4
    assert np.allclose(corner(made.mesh), corner(msh), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("echo '## Error: no memory' >&2; exit 3", r"MMG has failed \(3\): ## Error: no memory"),
        ("exit 0", r"MMG has failed \(0\)"),
        ('head -n 2 "$1" > "$out"', "no tetrahedra"),
        ('head -n 9 "$1" > "$out"', "Vertices that are not complete"),
        ('sed \'/^Triangles/,/^Edges/d\' "$1" > "$out"', "no tetrahedra, or no triangles"),
    ],
    ids=["error", "nothing", "empty", "cut off", "no boundary"],
)
def test_what_it_cannot_make_is_an_error_on_all_ranks(program, change, said):
    program(change)
    msh, tags = cylinder()
    before = msh.geometry.x.copy()
    with pytest.raises(qs.RemeshError, match=said):
        qs.remesh(msh, 2.5, tags, mesher="mmg")
    assert np.array_equal(msh.geometry.x, before)


def test_where_it_is_not_installed_that_is_said(monkeypatch):
    monkeypatch.setattr(mmg, "PROGRAMS", ("there-is-none",))
    assert mmg.program() is None
    box = mesh.create_box(WORLD, [[0.0] * 3, [1.0] * 3], [2, 2, 2])
    with pytest.raises(ValueError, match=r"mesher: .* on the PATH of rank 0; install MMG, or take"):
        qs.remesh(box, 0.4, mesher="mmg")
    with pytest.raises(ValueError, match=r"mesher: .* on the PATH of rank 0"):
        Upset(3, 5.0, remesh={"every": 3, "mesher": "mmg"})


def test_it_is_of_tetrahedra(program):
    program("exit 1")
    square = mesh.create_unit_square(WORLD, 3, 3)
    with pytest.raises(ValueError, match='mesher: "mmg" makes tetrahedra; take "gmsh" in 2D'):
        qs.remesh(square, 0.3, mesher="mmg")
    with pytest.raises(ValueError, match="mesher: must be one of gmsh, mmg"):
        qs.remesh(square, 0.3, mesher="netgen")


@installed
def test_box_keeps_its_planes_edges_and_corners():
    msh = mesh.create_box(WORLD, [[0, 0, 0], [1, 2, 3]], [3, 6, 8])
    planes = [(axis, value) for axis in range(3) for value in (0.0, (1.0, 2.0, 3.0)[axis])]
    made = qs.remesh(msh, 0.4, tagged(msh, planes), mesher="mmg")
    assert np.allclose([area(made, tag) for tag in range(1, 7)], [6, 6, 3, 3, 2, 2], rtol=1e-12)
    for tag, (axis, value) in enumerate(planes, 1):
        assert np.all(nodes_on(made, tag)[:, axis] == value)
    assert np.isclose(volume(made.mesh), 6, rtol=1e-12) and made.report.quality > 0.1


@installed
def test_sizes_are_kept_and_so_is_the_volume():
    msh, tags = cylinder()
    counts = []
    for size in (2.0, 1.0):
        made = qs.remesh(
            msh, [size, qs.size_from_curvature(msh, 0.3, 0.5, 2.0)], tags, mesher="mmg"
        )
        assert np.isclose(volume(made.mesh), volume(msh), rtol=1e-10)
        counts.append(made.report.num_cells)
    assert 4 < counts[1] / counts[0] < 12


@installed
def test_upsetting_goes_on_as_on_one_mesh():
    alone = Upset(3, 5.0).run()
    case = Upset(3, 5.0, remesh={"every": 3, "mesher": "mmg"})
    assert np.allclose(case.run(), alone, rtol=0.03)
    assert len(case.stepper.remeshings) == 3


def test_program_of_the_python_package(tmp_path, monkeypatch):
    """The compiled program in mmgpy is found without a PATH; its Python script is not used."""

    class Folder:
        def __init__(self, path):
            self.path = path

        def locate(self):
            return tmp_path / self.path

        name = property(lambda self: self.path.name)
        parts = property(lambda self: self.path.parts)

    paths = [pathlib.Path(f"{folder}/mmg3d_O3") for folder in ("bin", "mmgpy/bin")]
    for path in paths:
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).touch(0o755)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(importlib.metadata, "files", lambda name: [Folder(p) for p in paths])
    assert mmg.program() == str(tmp_path / paths[1])
    (tmp_path / paths[1]).chmod(0o644)
    assert mmg.program() is None
