"""Loads beyond which the next equilibrium is far away, or does not exist."""

import numpy as np
import pytest
from following import Body
from scenes import WORLD, box, plane

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

HEIGHT, THICKNESS = 0.25, 0.1
TOP = HEIGHT + THICKNESS


def arch(load, dt=0.1):
    """A shallow arch between walls, and a frictionless cylinder that pushes its crown down."""
    msh = box(WORLD, (24, 2), "quadrilateral", (-1.0, 0.0), (1.0, THICKNESS))
    x = msh.geometry.x
    x[:, 1] += HEIGHT * (1 - x[:, 0] ** 2)
    body = Body(msh, degree=2, stiffness=1e3)
    for side in (-1.0, 1.0):
        body.clamp(plane(msh, 0, side))
    top = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], THICKNESS + HEIGHT * (1 - x[0] ** 2))
    )
    tool = qs.RigidSurface.cylinder(WORLD, [0.0, TOP + 0.2], None, 0.2)
    contact = qs.Contact(body.surface(top), tool)
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    return tool, contact, qs.TimeStepper(problem, dt, lambda t, dt: load(tool, t, dt))


@pytest.mark.filterwarnings("ignore:.*snap-through")
def test_force_through_a_limit():
    """Under force control the arch snaps to a state that displacement control finds as well."""
    pushed, _, stepper = arch(lambda tool, t, dt: tool.drive(0.8 * t, [0.0, -1.0]))
    ways = []
    for _ in stepper.run(1.0):
        ways.append(TOP + 0.2 - float(pushed.center[1]))
    assert stepper.num_cutbacks <= 1
    assert max(np.diff(ways)) > HEIGHT > 20 * min(np.diff(ways))

    def move(tool, t, dt):
        tool.displacement = [0.0, -dt * ways[-1]]

    _, contact, stepper = arch(move)
    forces = [contact.force("master")[1] for _ in stepper.run(1.0)]
    assert min(np.diff(forces)) < 0  # beyond the limit point the force decreases
    assert forces[-1] == pytest.approx(0.8, rel=1e-6)


def test_no_equilibrium():
    """A push larger than friction has no equilibrium: the error does not advise smaller steps."""
    body = Body(box(WORLD, (3, 2), "quadrilateral", (0.0, 0.0), (1.0, 0.5)), stiffness=1e3)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    body.press(1, 0.5, 1.0)
    push = fem.Constant(body.mesh, 0.0)
    body.F -= push * body.v[0] * ufl.dx
    contact = qs.Contact(body.side(1, 0.0), floor, friction=qs.Coulomb(0.3))
    problem = qs.ContactProblem(
        [body.F], [body.u], [contact], [body.bcs], petsc_options={"snes_max_it": 20}
    )

    def drive(t, dt):
        push.value = 2 * t  # on an area of 0.5

    stepper = qs.TimeStepper(problem, 0.25, drive, dt_min=0.1)
    with pytest.raises(qs.StepError, match="drive it by displacements") as caught:
        for _ in stepper.run(1.0):
            state = body.u.x.array.copy()
    assert "qs.TimeStepper" not in str(caught.value)
    assert stepper.t == 0.25  # the maximum is 0.3
    np.testing.assert_array_equal(body.u.x.array, state)
