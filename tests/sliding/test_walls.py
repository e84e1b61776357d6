"""Block on a wider block in 3D with named walls of both, in steps, with friction."""

import warnings

from mpi4py import MPI

import numpy as np
import pytest
from following import WORLD, Body, but_for, problem_of, rotation
from scenes import box, plane

import qsdolfinx as qs

#: Press, press and drag: displacements along x and z.
WAYS = ((0.0, -0.02), (0.0, -0.05), (0.1, -0.05))


@pytest.mark.parametrize("shift", (0.0, 0.02, 0.07))
def test_lines_of_meshes_that_nearly_coincide(shift):
    """Points between nearly coinciding lines move far; friction of the last step is smooth there.

    Newton's method took 50 iterations where points had the values of the closest previous point,
    and where lines that coincide except for rounding crossed.
    """
    forces = []
    for sliding in ("small", "finite"):
        low = Body(box(WORLD, (8, 8, 3), "hexahedron", (0, 0, -0.5), (2, 2, 0)), stiffness=1e3)
        upper = (0.5 + shift, 0.5, 0), (1.5 + shift, 1.5, 1)
        high = Body(box(WORLD, (4, 4, 4), "hexahedron", *upper), stiffness=1e3)
        below, above = plane(low.mesh, 2, -0.5), plane(high.mesh, 2, 1.0)
        low.clamp(below)
        top = high.clamp(above)
        surfaces = but_for(high, above), but_for(low, below)
        contact = qs.Contact(*surfaces, friction=qs.Coulomb(0.3), sliding=sliding)
        problem = problem_of([low, high], [contact])
        for x, z in WAYS:
            top.value[[0, 2]] = x, z
            problem.solve()
            assert problem.num_iterations <= 14
        forces.append(contact.force("slave"))
    assert forces[1][0] / forces[1][2] == pytest.approx(-0.3, abs=0.02)
    np.testing.assert_allclose(forces[1], forces[0], atol=0.05 * forces[0][2])


def test_pad_whose_edge_is_on_a_mesh_line():
    """Nearly coinciding lines cross anywhere along a side: points elsewhere do not follow this.

    With a fan over all corners of the segments Newton's method stagnated at 1e-7 for 50 iterations.
    """
    plate = Body(box(WORLD, (8, 4, 2), "hexahedron", (0, 0, -0.4), (2, 1, 0)), stiffness=1e3)
    pad = Body(box(WORLD, (5, 4, 2), "hexahedron", (0.5, 0.15, 0), (1.3, 0.85, 0.3)), stiffness=1e2)
    below, above = plane(plate.mesh, 2, -0.4), plane(pad.mesh, 2, 0.3)
    plate.clamp(below)
    pad.clamp(above).value[2] = -0.0075
    surfaces = [body.surface(plane(body.mesh, 2, 0.0)) for body in (pad, plate)]
    contact = qs.Contact(*surfaces, friction=qs.Coulomb(0.2))
    problem = problem_of([plate, pad], [contact])
    problem.solve()
    assert problem.num_iterations <= 8


def walls_on_a_node(turn=None):
    """Make a rotated block with walls and a corner on a plate's node: contact, problem, top."""
    turn = np.eye(3) if turn is None else turn
    meshes = (
        box(WORLD, (5, 5, 1), "hexahedron", (0, 0, -0.5), (2, 2, 0)),
        box(WORLD, (2, 2, 1), "hexahedron", (0.4, 0.4, 0), (1.1, 1.15, 0.5)),
    )
    far = plane(meshes[0], 2, -0.5), plane(meshes[1], 2, 0.5)
    for msh in meshes:
        msh.geometry.x[:] = msh.geometry.x @ turn.T
    plate, block = (Body(msh, stiffness=E) for msh, E in zip(meshes, (1e3, 3e3), strict=True))
    plate.clamp(far[0])
    top = block.clamp(far[1])
    contact = qs.Contact(but_for(block, far[1]), but_for(plate, far[0]), friction=qs.Coulomb(0.2))
    return contact, problem_of([plate, block], [contact]), top


def test_default_does_not_depend_on_turns():
    """A wall's corner edge on a node is along the normal: it crosses nothing at any rotation."""
    turns = [None, *(rotation(0.7, axis) for axis in ((1, 2, 0.5), (-0.3, 1, 1), (0.2, -1, 0.4)))]
    assert [walls_on_a_node(turn)[0].sliding for turn in turns] == ["finite"] * 4


def test_checkpoint_of_walls(tmp_path):
    """Integration sides that only small sliding has leave nothing behind in a checkpoint."""
    folder = WORLD.bcast(tmp_path)
    forces = []
    for load in (False, True):
        contact, problem, top = walls_on_a_node()

        def drive(t, dt, top=top):
            top.value[:] = 0.01 * max(t - 1, 0), 0.0, -0.02 * min(t, 1.0)

        stepper = qs.TimeStepper(problem, 1.0, drive)
        if load:
            qs.load_run(stepper, folder)
        else:
            stepper.step()
            qs.save_run(stepper, folder)
        stepper.step()
        forces.append(contact.force("slave"))
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-9)


def test_block_that_hangs_over_an_edge():
    """An overhanging wall above a plate is outside, although it is behind the plate's end face.

    Inclined rays enter by the top. Formerly points of slivers had up to 27 times the mean pressure,
    a wrong warning was given, and for other overhangs no step was small enough.
    """
    plate = Body(box(WORLD, (8, 6, 2), "hexahedron", (0, 0, -0.5), (2, 1.5, 0)), stiffness=1e3)
    block = Body(
        box(WORLD, (4, 4, 3), "hexahedron", (1.78, 0.4, 0), (2.58, 1.1, 0.5)), stiffness=5e2
    )
    below, above = plane(plate.mesh, 2, -0.5), plane(block.mesh, 2, 0.5)
    plate.clamp(below)
    top = block.clamp(above)
    contact = qs.Contact(but_for(block, above), but_for(plate, below), sliding="finite")
    problem = problem_of([plate, block], [contact])
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ContactWarning)
        for depth in (0.005, 0.01, 0.02):
            top.value[2] = -depth
            problem.solve()
            assert problem.num_iterations <= 12
            pressures = contact.model.gaps[0].multiplier(contact.model.eps)[:, 0]
            largest = WORLD.allreduce(float(pressures.max(initial=0.0)), op=MPI.MAX)
            assert largest < 3 * contact.force("slave")[2] / (0.22 * 0.7)


@pytest.mark.parametrize("stiffness", (1e5, 1e6))
def test_stiff_punch_with_walls(stiffness):
    """The rim of a stiff punch presses facets of a block down, also where it meets their edges.

    With directions of forces that jump at edges of facets there was no equilibrium: active sets
    repeated, and a warning told that the rim was not supported.
    """
    forces = []
    for swapped in (False, True):
        block = Body(box(WORLD, (6, 6, 3), "hexahedron", (0, 0, 0), (1, 1, 0.5)), stiffness=1e3)
        upper = (0.3, 0.3, 0.5), (0.7, 0.7, 0.9)
        punch = Body(box(WORLD, (4, 4, 4), "hexahedron", *upper), stiffness=stiffness)
        below, above = plane(block.mesh, 2, 0.0), plane(punch.mesh, 2, 0.9)
        block.clamp(below)
        punch.clamp(above).value[2] = -0.03
        surfaces = block.side(2, 0.5), but_for(punch, above)
        contact = qs.Contact(*surfaces[:: -1 if swapped else 1], sliding="finite")
        problem = problem_of([block, punch], [contact])
        with warnings.catch_warnings():
            warnings.simplefilter("error", qs.ContactWarning)
            problem.solve()
        assert problem.num_iterations <= 20
        forces.append(abs(contact.force("slave")[2]))
    assert forces[0] == pytest.approx(forces[1], rel=0.01)
