"""A soft surface that sticks to a tool folds; a little viscosity follows it."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.solve.snes import REMEDY, in_smallest_step


class Drag:
    """A rubber slab under a cylinder that is pressed by half its radius, and dragged at μ = 0.7.

    Args:
        viscosity: Times the shear modulus, for a strain in the time of the drag.
        dt: Time step; none is smaller than a fifth of it.
    """

    RADIUS, DEPTH = 0.5, 0.25

    def __init__(self, viscosity, dt=0.05):
        msh = box(WORLD, [36, 12], "quadrilateral", [-1.5, -1.0], [1.5, 0.0])
        V = vector_space(msh)
        u, v, self.before = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
        self.u, self.dt, self.at = u, fem.Constant(msh, dt), np.zeros(2)
        rate = ufl.grad(u - self.before) / self.dt
        stress = qs.materials.neo_hookean(u, 1.0, 5.0)
        F = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=4)
        F += fem.Constant(msh, viscosity) * ufl.inner(rate, ufl.grad(v)) * ufl.dx(degree=3)
        self.tool = qs.RigidSurface.cylinder(WORLD, [-0.4, self.RADIUS], None, self.RADIUS)
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        self.contact = qs.Contact(surface, self.tool, friction=qs.Coulomb(0.7))
        problem = qs.ContactProblem(F, u, self.contact, [clamp(V, plane(msh, 1, -1.0))])
        self.stepper = qs.TimeStepper(problem, dt, self.drive, dt_min=dt / 5)

    def drive(self, t, dt):
        """Press until t = 1, then drag."""
        self.dt.value, self.before.x.array[:] = dt, self.u.x.array
        there = np.array([max(t - 1, 0.0), -self.DEPTH * min(t, 1.0)])
        begun = np.array([max(t - dt - 1, 0.0), -self.DEPTH * min(t - dt, 1.0)])
        self.tool.displacement = there - begun

    def run(self):
        """Drag by 0.7; return the force on the tool."""
        for _ in self.stepper.run(1.7):
            pass
        return self.contact.force("master")


@pytest.mark.parametrize("shapes, tools", ((True, True), (False, True), (False, False)))
@pytest.mark.parametrize("finite", (True, False))
def test_remedies(shapes, tools, finite):
    """The remedies are those that apply: corners not to shapes, roles not to tools."""
    text = in_smallest_step(RuntimeError(REMEDY), shapes, tools, finite)
    assert ("corners" in text) == (not shapes) and ("swap" in text) == (not tools)
    assert ("small" in text) == finite and "refine" in text and "damping" in text


@pytest.mark.long
def test_viscosity():
    """Without viscosity the drag ends, with the remedies for this tool; with some it goes on."""
    scene = Drag(0.0)
    with pytest.raises(qs.StepError) as caught:
        scene.run()
    assert "a soft surface that sticks may fold" in str(caught.value)
    assert "give F damping" in str(caught.value)
    assert "corners" not in str(caught.value) and "swap" not in str(caught.value)
    along, upwards = Drag(0.02).run()
    assert 0.85 < -along / upwards < 0.95
