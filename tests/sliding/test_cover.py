"""Finite sliding: area of the other surface that covers each node."""

import warnings

import numpy as np
import pytest
from following import Body, Boxes, problem_of
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


@pytest.mark.parametrize("swap", (False, True))
def test_end_that_slides_along_facets(swap):
    """Pressures at the end of a plate do not oscillate as a block slides off it.

    With the constraints of hardly covered nodes alone they reached twenty times the mean pressure.
    """
    plate = Body(box(WORLD, (18, 3), "quadrilateral", [0.0, -0.3], [2.0, 0.0]), stiffness=1e4)
    block = Body(box(WORLD, (10, 5), "quadrilateral", [1.1, 0.0], [2.1, 0.5]))
    plate.clamp(plane(plate.mesh, 1, -0.3))
    motion = block.clamp(plane(block.mesh, 1, 0.5))
    surfaces = block.side(1, 0.0), plate.side(1, 0.0)
    contact = qs.Contact(*(surfaces[::-1] if swap else surfaces), sliding="finite")

    def drive(t, dt):
        motion.value[:] = 0.01 * max(t - 1, 0.0), -0.02 * min(t, 1.0)

    stepper = qs.TimeStepper(problem_of([plate, block], [contact]), 1.0, drive)
    for t in stepper.run(22.0):  # by two facets
        assert stepper.num_iterations <= 8
        mean = -contact.force("slave")[1] / (0.9 - 0.01 * max(t - 1, 0.0))
        multipliers = contact.model.gaps[0].state.augmented
        assert largest(multipliers) < 8 * abs(mean)
    assert stepper.num_cutbacks == 0


def test_facets_without_area():
    """Multipliers are determined where a facet has no area at a trial position."""
    plate = Body(box(WORLD, (8, 2), "quadrilateral", [0.0, -0.5], [4.0, 0.0]))
    block = Body(box(WORLD, (3, 2), "quadrilateral", [1.2, 0.0], [2.2, 1.0]))
    for body, up in ((plate, -0.5), (block, 1.0)):
        body.clamp(plane(body.mesh, 1, up))
    contact = qs.Contact(plate.side(1, 0.0), block.side(1, 0.0), sliding="finite")
    problem = problem_of([plate, block], [contact])
    problem.set_up()
    equations = qs.Equations(problem.system)
    z = equations.first()
    at = plate.V.tabulate_dof_coordinates()[: plate.num_owned // 2]
    last = (at[:, 0] > 3.9) & (at[:, 1] > -0.1)
    equations.part(z, 0).reshape(-1, 2)[last, 0] = -0.5  # onto the next node
    equations.evaluate(z)
    areas = equations.passes[0].rows.condensed.areas
    assert WORLD.allreduce(len(areas)) == 9 and np.all(areas > 0)


@pytest.mark.parametrize("width", (0.02, 0.1))
def test_patch_on_a_narrow_pad(width):
    """A block on two stiff plates has one pressure, also where a plate is a part of its facet.

    Multipliers far away must not pull on those of the few nodes that the narrow plate covers.
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
