"""Bodies in corners of several walls, named as one surface, with constraints at nodes."""

import numpy as np
import pytest
from corners import PRESS, InCorner
from scenes import WORLD, largest

import qsdolfinx as qs

AUGMENTED = {"enforcement": "augmented-lagrangian"}
FRICTION = {"friction": qs.Coulomb(0.3)}

SCENES = {
    "2D": {},
    "triangles": {"cell": "triangle"},
    "turned": {"angle": np.pi / 4},
    "tool": {"master": "rigid"},
    "from a gap": {"gap": 0.004},
    "block as master": {"block_first": False},
    "edge": {"cell": "hexahedron", "n": (2, 3)},
    "corner": {"cell": "tetrahedron", "walls": 3, "n": (2, 3)},
    "corner of a tool": {"cell": "tetrahedron", "walls": 3, "n": (2, 3), "master": "rigid"},
}
CASES = [
    ("master-slave", {}),
    ("quasi-symmetric", {}),
    ("double-pass", {}),
    ("master-slave", AUGMENTED),
    ("quasi-symmetric", AUGMENTED),
    ("quasi-symmetric", FRICTION),
    ("quasi-symmetric", AUGMENTED | FRICTION),
]


def depth_in_walls(scene):
    """Return the depth of the block's corner in each wall, if the walls do not move."""
    x = scene.block.geometry.x
    at = np.flatnonzero(np.all(np.abs(x[:, : scene.walls]) < 1e-9, axis=1))
    u = scene.u[-1].x.array.reshape(-1, scene.gdim)[at, : scene.walls]
    return largest(np.maximum(-u, 0.0))


@pytest.mark.parametrize("formulation, options", CASES)
@pytest.mark.parametrize("name", SCENES)
def test_walls_push_alike(name, formulation, options):
    """Walls carry equal forces by symmetry, the same as with one contact and one pair per wall."""
    if name.endswith("tool") and formulation == "double-pass":
        return
    given = SCENES[name] | {"formulation": formulation} | options
    scene, named = InCorner(**given), InCorner(named=True, **given)
    for problem in (scene.solve(), named.solve()):
        problem.destroy()
    force, size = scene.forces(), np.abs(scene.forces()).max()
    if name == "turned":
        assert abs(force[0]) < 1e-10 * size < force[1]
    else:
        assert np.ptp(force[: scene.walls]) < 1e-10 * size
        assert size > 0.01
    np.testing.assert_allclose(force, named.forces(), atol=1e-10 * size)
    for u, other in zip(scene.u, named.u, strict=True):
        assert largest(u.x.array - other.x.array) < 1e-9 * PRESS
    assert WORLD.allreduce(scene.num_corners()) > 0 == WORLD.allreduce(named.num_corners())


@pytest.mark.parametrize("name", ("tool", "corner of a tool"))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
def test_corner_stays_out_of_both_walls(name, formulation):
    """The corner node does not penetrate any wall, with a penalty or with multipliers."""
    for options, most in (({"penalty": 1e4}, 1e-3), (AUGMENTED, 1e-6)):
        scene = InCorner(formulation=formulation, **SCENES[name], **options)
        scene.solve().destroy()
        assert depth_in_walls(scene) < most * PRESS
        (contact,) = scene.contacts
        assert contact.weighted_penetration() < most * PRESS
        assert contact.penetration() < 3 * most * PRESS


@pytest.mark.parametrize("angle", (0.0, 0.3))
def test_unequal_walls(angle):
    """Each wall has its own multipliers; pressed against one of two, those of the other vanish."""
    scenes = []
    for named in (False, True):
        given = {"press": (0.02, -0.005), "angle": angle, "named": named}
        scenes.append(InCorner(formulation="quasi-symmetric", **given, **AUGMENTED))
        scenes[-1].solve().destroy()
    forces = [scene.forces() for scene in scenes]
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-10 * np.abs(forces[1]).max())
    (gap,) = scenes[0].contacts[0].model.gaps
    assert WORLD.allreduce(int(np.count_nonzero(gap.rows.in_corner))) == 2


@pytest.mark.parametrize("master", ("elastic", "rigid"))
@pytest.mark.parametrize("options", (AUGMENTED, AUGMENTED | FRICTION))
def test_pairing_anew_keeps_each_multiplier(master, options):
    """Updating the contact pairs keeps the multiplier of every wall at the corner node."""
    scene = InCorner(press=(0.02, 0.01), master=master, formulation="quasi-symmetric", **options)
    problem = scene.solve()
    (contact,) = scene.contacts
    parts = contact.model.parts
    before = [part.state.augmented for part in parts]
    contact.update()
    for part, old, kept in zip(contact.model.parts, parts, before, strict=True):
        assert part is not old
        assert largest(part.state.augmented - kept) < 1e-12 * largest(kept)
    rows = contact.model.gaps[0].rows
    at_corner = before[0][rows.in_corner, 0]
    assert WORLD.allreduce(np.count_nonzero(np.unique(np.round(at_corner, 9)) > 0)) == 2
    problem.destroy()


def test_what_nodes_in_corners_show():
    """Results at corner nodes: area-weighted mean multipliers, all friction work, active status."""
    scene = InCorner(press=(0.02, 0.01), formulation="quasi-symmetric", **FRICTION)
    scene.solve().destroy()
    (contact,) = scene.contacts
    (gap,), comm = contact.model.gaps, WORLD
    rows = gap.rows
    area, shown = np.zeros(len(contact.slave.node_area)), contact.multiplier()
    np.add.at(area, gap.operator.row_node, gap.operator.row_area)
    of_rows = gap.operator.row_area @ gap.multiplier(contact.model.eps)[:, 0]
    np.testing.assert_allclose(comm.allreduce(area @ shown), comm.allreduce(of_rows), rtol=1e-12)
    work = comm.allreduce(contact.dissipation().sum())
    np.testing.assert_allclose(work, contact.step_dissipation(), rtol=1e-12)
    assert np.all(contact.active()[gap.operator.row_node[rows.in_corner]])
    assert contact.patch()[0] == pytest.approx(comm.allreduce(gap.operator.row_area.sum()))


@pytest.mark.parametrize("part", (0.0, 0.4, 1.0))
def test_overclosure_of_each_wall(part):
    """The overclosure allowed in one wall is not allowed in the other."""
    scene = InCorner(master="rigid", gap=(-0.02, -0.01), press=0.0)
    (contact,) = scene.contacts
    contact.allow_overclosure(part)
    contact.update()
    scene.solve().destroy()
    gap = contact.model.gaps[0]
    depth = np.where(np.abs(gap.operator.slave_sum[:, 0]) > 0.5, 0.02, 0.01)
    np.testing.assert_allclose(gap.state.allowance, part * depth, atol=1e-12)
    if part == 1.0:
        assert largest(scene.u[-1].x.array) < 1e-12
