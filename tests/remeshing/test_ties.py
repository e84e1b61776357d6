"""New meshes do not depend on rounding or on the partition of the old mesh."""

import numpy as np
import pytest
from forming_bodies import quarter_cylinder
from remeshing_scenes import all_nodes, num_cells
from scenes import WORLD

from dolfinx import fem, mesh

import qsdolfinx as qs

pytest.importorskip("gmsh")


def block(comm, n, bulge=0.1):
    """A pressed block with several symmetries."""
    msh = mesh.create_box(comm, [[0, 0, 0], [10, 10, 8]], n)
    x = msh.geometry.x
    x[:, :2] *= 1 + bulge * np.sin(np.pi * x[:, 2:] / 8)
    return msh


def cube(comm, n, turn=0.0):
    """A cube with planes normal to the axes, or tilted."""
    msh = mesh.create_unit_cube(comm, n, n, n)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    for columns in (slice(0, 2), slice(1, 3)):
        msh.geometry.x[:, columns] = msh.geometry.x[:, columns] @ turned
    return msh


def bracket(comm):
    """An L-shaped body; its re-entrant edge is one of the lines that are kept."""
    msh = mesh.create_box(comm, [[0, 0, 0], [2, 2, 1]], [4, 4, 2])
    msh.topology.create_connectivity(3, 3)
    inside = mesh.locate_entities(msh, 3, lambda x: (x[0] < 1.01) | (x[1] < 1.01))
    return mesh.create_submesh(msh, 3, inside)[0]


def cylinder(comm):
    return quarter_cylinder(comm, 10.0, 0.0, 6.0, 2.5)


def section(comm, n, width, height, bulge):
    msh = mesh.create_rectangle(comm, [[0, 0], [width, height]], n)
    msh.geometry.x[:, 0] *= 1 + bulge * np.sin(np.pi * msh.geometry.x[:, 1] / height)
    return msh


#: Bodies, and sizes for which many edges have equal lengths, or lie half-way between two numbers.
SCENES = {
    "block": (lambda comm: block(comm, [3, 3, 3]), 3.5),
    "turned cube": (lambda comm: cube(comm, 4, 0.5), 0.3),
    "bracket": (bracket, 0.4),
    "cylinder": (cylinder, 2.5),
    "square": (lambda comm: section(comm, [4, 4], 1.0, 1.0, 0.0), 2 / 7),
    "barrel": (lambda comm: section(comm, [8, 12], 10.0, 15.0, 0.1), 1.1),
}

MORE = {
    f"block {n}, {size}": (lambda comm, n=n: block(comm, n), size)
    for n in ([3, 3, 3], [4, 4, 4], [3, 3, 4])
    for size in (2.5, 3.0, 3.5)
} | {
    "cube 4, 0.25": (lambda comm: cube(comm, 4), 0.25),
    "cube 4, 0.3": (lambda comm: cube(comm, 4), 0.3),
    "cube 5, 0.2": (lambda comm: cube(comm, 5), 0.2),
    "turned cube 4, 0.25": (lambda comm: cube(comm, 4, 0.5), 0.25),
    "cylinder, 2": (cylinder, 2.0),
    "bracket, 0.3": (bracket, 0.3),
    "square, 0.2": (lambda comm: section(comm, [4, 4], 1.0, 1.0, 0.0), 0.2),
    "barrel, 0.75": (lambda comm: section(comm, [8, 12], 10.0, 15.0, 0.1), 0.75),
}

LONG = [pytest.param(*scene, id=name, marks=pytest.mark.long) for name, scene in MORE.items()]


@pytest.mark.parametrize(
    ("body", "size"), [*(pytest.param(*scene, id=name) for name, scene in SCENES.items()), *LONG]
)
def test_rounding_does_not_decide(body, size):
    """Small solver errors, which depend on the number of ranks, do not change the cells."""
    first = qs.remesh(body(WORLD.Split(WORLD.rank)), size).mesh
    for noise in (1e-9, -1e-9, 3e-10):
        msh = body(WORLD)
        x = msh.geometry.x
        wave = np.sin(40 * x / size) + np.sin(30 * np.roll(x, 1, axis=1) / size + 1)
        x += noise * size * wave * (x != 0)
        x[:, msh.geometry.dim :] = 0
        second = qs.remesh(msh, size).mesh
        assert num_cells(second) == num_cells(first)
        assert np.allclose(all_nodes(second), all_nodes(first), rtol=0, atol=1e-8 * size)


@pytest.mark.parallel
@pytest.mark.parametrize("kind", ["sizes of cells", "refined"])
def test_numbers_that_the_parts_have_do_not_decide(kind):
    """Local numbering does not change the cells.

    Cases: a size that jumps between cells, and a mesh that was refined in parallel.
    """

    def make(comm):
        msh = mesh.create_unit_cube(comm, 3, 3, 3)
        if kind == "refined":
            msh.topology.create_entities(1)
            return qs.remesh(mesh.refine(msh)[0], 0.3).mesh
        size = fem.Function(fem.functionspace(msh, ("DG", 0)))
        size.interpolate(lambda x: np.where(np.sin(9 * x[0] + 7 * x[1] + 5 * x[2]) > 0, 0.3, 0.4))
        return qs.remesh(msh, size).mesh

    alone, together = make(WORLD.Split(WORLD.rank)), make(WORLD)
    assert np.allclose(all_nodes(alone), all_nodes(together), rtol=0, atol=1e-12)


def test_angles_that_are_just_those_asked_for():
    """Facets at exactly the feature angle are not sharp, whatever the rounding."""
    counts = set()
    for noise in (0.0, 1e-9, -1e-9):
        msh = mesh.create_rectangle(WORLD, [[1, 0], [2, 6]], [1, 6])
        x = msh.geometry.x
        r, angle = x[:, 0] + noise * np.sin(40 * x[:, 1]), np.pi * 2 / 9 * x[:, 1]
        x[:, 0], x[:, 1] = r * np.cos(angle), r * np.sin(angle)
        counts.add(num_cells(qs.remesh(msh, 0.5, feature_angle=40.0).mesh))
    assert len(counts) == 1
