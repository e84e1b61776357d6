"""Finite sliding: area of the other surface that covers each node."""

import warnings

import numpy as np
import pytest
from following import Body, Boxes, create, problem_of
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron", "hexahedron"))
def test_whole_faces_cover_whole_nodes(cell, formulation):
    """Where blocks meet with whole faces, each node is covered by its whole area."""
    gdim = 2 if cell == "quadrilateral" else 3
    up, F, u, bcs, surfaces = gdim - 1, [], [], [], []
    for low, n in ((0.0, 3), (1.0, 4)):
        corner = [*[0.0] * up, low]
        end = [*[1.0] * up, low + 1.0]
        msh = box(WORLD, [*[n] * up, 2], cell, corner, end, "scattered")
        V = vector_space(msh)
        u.append(fem.Function(V))
        F.append(elastic(u[-1]))
        bcs.append([clamp(V, plane(msh, up, 2 * low))])
        surfaces.append(qs.Surface(V, facets=plane(msh, up, 1.0)))
    contact = qs.Contact(*surfaces, sliding="finite", formulation=formulation)
    qs.ContactProblem(F, u, [contact], bcs).solve()
    cut = contact.model.gaps[0].cut
    assert largest(cut.found.cover.sum(axis=1) - cut.node_area) < 1e-12


def test_areas_of_rings():
    """On axisymmetric surfaces, areas of patches are those of rings, as the cover is."""
    bodies = [
        Body(box(WORLD, (4, 2), "quadrilateral", [1.0, z], [3.0, z + 1.0]), axisymmetric=True)
        for z in (0.0, 1.0)
    ]
    for body, z in zip(bodies, (0.0, 2.0), strict=True):
        body.clamp(plane(body.mesh, 1, z))
    contact = qs.Contact(*(body.side(1, 1.0) for body in bodies), sliding="finite")
    problem_of(bodies, [contact]).solve()
    rows = contact.model.gaps[0].rows
    whole = WORLD.allreduce(rows.area_of_sides.sum()), WORLD.allreduce(rows.paired.sum())
    assert whole == pytest.approx((8 * np.pi, 8 * np.pi), rel=1e-12)


def test_nodes_that_are_left():
    """A block leaves nodes of a longer plate, the slave, at its very edge."""
    n, sizes = ((24, 4), (5, 5)), ((4.0, 1.0), (1.0, 1.0))
    case = Boxes("quadrilateral", n, sizes, start=1.2)
    motion = case.clamp_far()
    contact = qs.Contact(case.below, case.above, friction=qs.Coulomb(0.3), sliding="finite")

    def drive(t, dt):
        motion.value[:] = 0.1 * max(t - 2, 0.0), -0.01 * min(t / 2, 1.0)

    stepper = qs.TimeStepper(case.problem(contact), 1.0, drive)
    for _ in stepper.run(6.0):  # in the fifth step the end comes to a node of the plate
        assert stepper.num_iterations <= 16
    assert stepper.num_cutbacks == 0
    assert contact.force("slave")[0] > 0.29 * -contact.force("slave")[1]


@pytest.mark.parametrize("over", (2e-4, 2e-3, 0.06))
def test_block_that_covers_little_of_some_nodes(over):
    """A block whose edges are just beyond mesh lines of the plate, the slave, is pressed evenly.

    There is no warning that the nodes that are covered do not settle.
    """
    plate = Body(box(WORLD, (4, 4, 1), "hexahedron", (-1.0, -1.0, -0.5), (1.0, 1.0, 0.0)))
    block = Body(box(WORLD, (5, 5, 2), "hexahedron", (-0.6, -0.6, 0.0), (0.5 + over,) * 2 + (0.6,)))
    for axis in range(3):
        plate.hold(axis, 2, -0.5, 0.0)
        plate.hold(axis, 2, 0.0, 0.0)
    for axis in range(2):
        block.hold(axis, axis, -0.6)
    block.press(2, 0.6, 1e-3)
    contact = qs.Contact(plate.side(2, 0.0), block.side(2, 0.0), sliding="finite")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem_of([plate, block], [contact]).solve()
    area = (1.1 + over) ** 2
    assert contact.force("slave")[2] == pytest.approx(-1e-3 * area, rel=1e-8)
    assert largest(contact.penetration()) < 1e-9


@pytest.mark.parametrize("width", (0.02, 0.1))
def test_patch_on_a_narrow_pad(width):
    """A block on two stiff plates has one pressure, also where a plate is a part of its facet.

    Multipliers of nodes that are not covered do not pull on those of the narrow plate.
    """
    up = Body(box(WORLD, (4, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0]))
    plates = [
        Body(box(WORLD, (n, 2), "quadrilateral", [a, -1.0], [b, 0.0]), stiffness=1e4)
        for n, a, b in ((1, 0.0, width), (5, width, 1.0))
    ]
    for body, a, b in zip((up, *plates), (0.0, 0.0, width), (1.0, width, 1.0), strict=True):
        body.hold(0, 0, a)
        body.hold(0, 0, b)
    for plate in plates:
        plate.hold(1, 1, -1.0)
    up.hold(1, 1, 1.0, -0.02)
    contacts = [qs.Contact(up.side(1, 0.0), b.side(1, 0.0), sliding="finite") for b in plates]
    problem_of([up, *plates], contacts).solve()
    narrow, wide = (c.force("slave")[1] for c in contacts)
    assert narrow / width == pytest.approx(wide / (1 - width), rel=1e-5)


@pytest.mark.parametrize("height", (0.021, 0.1))
def test_open_place_beside_a_narrow_tooth(height):
    """The force on a tooth narrower than a facet depends little on another tooth that is open.

    Both cover parts of neighbouring facets of the slave.
    """
    forces = []
    for second in (0.5, height):  # beyond the search distance, or near
        teeth = Body(quadrilaterals((1.35, 1.65, 0.0), (2.4, 2.6, second)))
        floor = Body(box(WORLD, (6, 3), "quadrilateral", [0.0, -1.5], [6.0, 0.0]))
        floor.clamp(plane(floor.mesh, 1, -1.5))
        teeth.clamp(plane(teeth.mesh, 1, 1.0), [0.0, -0.02])
        low = teeth.boundary(lambda x, y=second: np.isclose(x[1], 0.0) | np.isclose(x[1], y))
        contact = qs.Contact(floor.side(1, 0.0), teeth.surface(low), sliding="finite")
        problem_of([floor, teeth], [contact]).solve()
        forces.append(contact.force("slave")[1])
    assert forces[1] == pytest.approx(forces[0], rel=0.02)


def quadrilaterals(*teeth):
    """Mesh of one cell for each tooth, given by its sides and its lower end; they end at y = 1."""
    x = np.array([[u, v] for a, b, low in teeth for v in (low, 1.0) for u in (a, b)])
    return create("quadrilateral", x, np.arange(len(x)).reshape(-1, 4))
