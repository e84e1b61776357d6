"""Moments over time steps: forces act where the step ends, about where the tool is then."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

WAY = 0.3


def carried(kind, theta=0.5):
    """A block on a plane that is carried sideways with it, pressed by 10: stepper and contact."""
    msh = box(WORLD, (4, 4), "quadrilateral", [-0.5, 0.0], [0.5, 1.0], "scattered")
    V = vector_space(msh)
    u, top = fem.Function(V), plane(msh, 1, 1.0)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"unknown": kind} | ({"dt": 1.0} if kind == "velocity" else {})
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, floor, quadrature="overlay", penalty=1e4, **options)
    motion = fem.Constant(msh, np.zeros(2))
    bc = fem.dirichletbc(motion, fem.locate_dofs_topological(V, 1, top), V)
    problem = qs.ContactProblem([elastic(u, E=1e3, nu=0.0)], [u], [contact], [[bc]])

    def drive(t, dt):
        floor.displacement = [WAY * dt, 0.0]
        if kind == "velocity":
            motion.value = [WAY, -0.01]
        else:
            motion.value = [WAY * t, -0.01]

    return qs.TimeStepper(problem, 1.0, drive, theta=theta), contact, floor


@pytest.mark.parametrize("kind, theta", (("displacement", 0.5), ("velocity", 0.5), ("velocity", 0)))
def test_a_block_that_is_carried(kind, theta):
    """Its middle is above the tool's centre, whatever step it is: no moment."""
    stepper, contact, floor = carried(kind, theta)
    seen = []
    stepper.on_solved = lambda: seen.append(contact.moment("slave")[0])
    for i in range(1, 4):
        stepper.step()
        force = contact.force("slave")[1]
        assert force > 5
        assert abs(contact.moment("slave")[0]) < 1e-8 * force
        assert abs(contact.moment("master")[0]) < 1e-8 * force
        assert abs(seen[-1]) < 1e-8 * force
        # About a fixed point the force has the arm that the block has come.
        np.testing.assert_allclose(contact.moment("slave", [0.0, 0.0]), WAY * i * force, rtol=1e-8)
    np.testing.assert_allclose(floor.center, [3 * WAY, 0.0], atol=1e-12)
