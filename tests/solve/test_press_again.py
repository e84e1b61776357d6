"""Nonlinear bodies that are pressed, unloaded and pressed again."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, plane, vector_space
from step_scenes import Upset

import ufl
from dolfinx import fem

import qsdolfinx as qs

ENFORCEMENTS = ("penalty", "augmented-lagrangian")
HEIGHTS = (-0.1, -0.2, -0.05, 0.05, 0.1, -0.15)


@pytest.mark.parametrize("driven", (False, True))
@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("enforcement", ENFORCEMENTS)
def test_neo_hookean(enforcement, constraints, driven):
    """Forces do not depend on the cycle, and vanish twice in a row when the plane is lifted."""
    msh = box(WORLD, (6, 6), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    F = ufl.inner(qs.materials.neo_hookean(u, 1.0, 0.3), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0])
    top = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(top, tool, enforcement=enforcement, constraints=constraints)
    problem = qs.ContactProblem([F], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
    forces = []
    for height in 3 * HEIGHTS:
        if driven and height < 0:
            tool.drive(-height, [0.0, -1.0])
        else:
            if driven:
                tool.release()
            tool.displacement = [0.0, height]
        problem.solve()
        forces.append(-contact.force("slave")[1])
    first, *others = np.reshape(forces, (3, -1))
    pressed = np.array(HEIGHTS) < 0
    assert np.all(np.abs(first[~pressed]) < 1e-12) and np.all(first[pressed] > 0.03)
    for cycle in others:
        np.testing.assert_allclose(cycle, first, rtol=1e-6, atol=1e-12)


class Billet(Upset):
    """A billet that is pressed and released, with a Newtonian or Norton-Hoff law."""

    def __init__(self, exponent, **options):
        self.exponent = exponent
        super().__init__(dt=0.02, drive=self.cycle, **options)

    def stress(self):
        v = ufl.split(self.w)[0]
        if self.exponent is None:
            return qs.materials.newtonian(v, 3.0)
        return qs.materials.norton_hoff(v, 3.0, self.exponent, 1e-3)

    def cycle(self, t, dt):
        phase = (t - 1e-9) % 0.1
        speed = -1.0 if phase < 0.06 else 2.0 if phase < 0.08 else -0.5
        self.tool.displacement = [0.0, speed * dt]


@pytest.mark.parametrize("die", (False, True))
@pytest.mark.parametrize("exponent", (None, 0.2))
@pytest.mark.parametrize("enforcement", ENFORCEMENTS)
def test_billet(enforcement, exponent, die):
    """After each of three presses, with two steps of rest, no force remains; few steps fail.

    At rest, velocities and their divergence are at the rounding level of the forces.
    """
    case = Billet(exponent, die=die, contact={"enforcement": enforcement})
    largest = 0.0
    for t in case.stepper.run(0.3):
        force = -case.contacts[1].force("slave")[1]
        largest = max(largest, force)
        if (t - 1e-9) % 0.1 > 0.06:
            assert abs(force) < 1e-6 * largest
    assert case.stepper.num_cutbacks <= 1  # depends on rounding, for some numbers of ranks
