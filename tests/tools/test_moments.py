"""Moment-controlled rigid tools: they rotate until contact balances the moment."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

E = 1e3


class Lever:
    """A block below 0, clamped at its bottom, and a wedge on an arm that rotates onto it.

    Args:
        gdim: Dimension of space.
        solver: Linear solver.
        rings: Whether the problem is axisymmetric.
        options: Options of the contact.
    """

    def __init__(self, gdim, solver="auto", rings=False, **options):
        low, n = [-1.0 + rings, *[-0.25] * (gdim - 2), -0.5], [8, *[2] * (gdim - 2), 2]
        cell = "quadrilateral" if gdim == 2 else "hexahedron"
        self.msh = box(WORLD, n, cell, low, [1.0, *[0.25] * (gdim - 2), 0.0], "scattered")
        V, up = vector_space(self.msh), gdim - 1
        self.u, self.bcs = fem.Function(V), [clamp(V, plane(self.msh, up, -0.5))]
        x = np.array([[0.7, 0.6], [0.1, 0.0], [-0.5, 0.6]])
        edges = [[1, 0], [2, 1]]
        center = [-1.4, 0.3]
        if gdim == 3:
            x = np.array([[a, y, b] for y in (-1.0, 1.0) for a, b in x])
            edges = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
            normal = np.cross(x[1] - x[0], x[4] - x[0])
            edges = edges if normal[2] < 0 else [e[::-1] for e in edges]
            center = [-1.4, 0.0, 0.3]
        self.tool = qs.RigidSurface.triangulated(WORLD, x, edges, center=center)
        self.contact = qs.Contact(
            qs.Surface(V, facets=plane(self.msh, up, 0.0), axisymmetric=rings),
            self.tool,
            **options,
        )
        self.problem = qs.ContactProblem(
            [elastic(self.u, E, 0.3)], [self.u], [self.contact], [self.bcs], linear_solver=solver
        )
        self.axis = None if gdim == 2 else [0.0, 1.0, 0.0]
        self.sign = -1.0 if gdim == 2 else 1.0  # clockwise in the x-z plane

    def moment(self):
        """Moment of the contact forces on the tool, about its axis of rotation."""
        found = self.contact.moment("master", self.tool.center)
        return found[0] if self.axis is None else found @ np.array(self.axis)


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("gdim", (2, 3))
def test_lever(gdim, friction):
    """The moment of the contact forces balances the driving moment.

    Prescribing the same angle gives the same forces.
    """
    lever = Lever(gdim, friction=friction)
    lever.tool.drive_moment(lever.sign * 3.0, lever.axis)
    lever.problem.solve()
    assert lever.problem.num_iterations <= 10
    np.testing.assert_allclose(lever.moment(), -lever.sign * 3.0, rtol=2e-2)
    if friction is None:  # an arm of 1.5, and an upward force
        np.testing.assert_allclose(lever.contact.force("master")[-1], 2.0, rtol=2e-2)
    angle = lever.tool.rotation.copy()
    assert 0 < np.abs(angle).max() < 0.1
    other = Lever(gdim, friction=friction)
    other.tool.rotation = angle
    other.problem.solve()
    force = lever.contact.force("slave")
    np.testing.assert_allclose(other.contact.force("slave"), force, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("constraints", ("points", "nodes"))
def test_derivative(constraints, friction):
    """The tangent is the derivative of the residual, also with respect to the angle."""
    lever = Lever(2, constraints=constraints, friction=friction)
    lever.tool.drive_moment(-3.0)
    equations = lever.problem.equations()
    rng = np.random.default_rng(WORLD.rank)
    z = 1e-3 * rng.normal(size=equations.num_local)
    if WORLD.rank == 0:
        z[-1] = -0.03  # the angle
    change, h = rng.normal(size=len(z)), 1e-6
    there = [equations.residual(z + step * h * change) for step in (1, -1)]
    by_difference = (there[0] - there[1]) / (2 * h)
    A = equations.tangent(z)
    x, y = A.createVecs()
    x.array[:] = change
    A.mult(x, y)
    scale = largest(by_difference)
    assert largest(y.array - by_difference) < 1e-6 * scale


@pytest.mark.parametrize("solver", ("direct", "amg"))
def test_steps(solver):
    """A moment may grow in time steps, where contact is updated at the tool's position."""
    lever = Lever(3, solver=solver)

    def drive(t, dt):
        lever.tool.drive_moment(30.0 * t, lever.axis)

    stepper = qs.TimeStepper(lever.problem, 0.25, drive)
    angles = []
    for _ in stepper.run(1.0):
        moment = 30.0 * stepper.t
        np.testing.assert_allclose(lever.moment(), -moment, rtol=1e-2)
        R = lever.tool.position[:, :3]
        angles.append(np.arcsin(R[0, 2]))
    assert np.all(np.diff(angles) > 0) and stepper.num_cutbacks == 0
    assert max(row.iterations for row in stepper.log.rows) <= 12


def test_bad_moments():
    """Invalid moments, and settings without support for moments, raise an error."""
    lever = Lever(2)
    with pytest.raises(ValueError, match="moment: must not be zero"):
        lever.tool.drive_moment(0.0)
    with pytest.raises(ValueError, match="axis: there is one alone in 2D"):
        lever.tool.drive_moment(1.0, [0.0, 0.0, 1.0])
    assert lever.tool.driven is None
    for options, message in (({"sliding": "finite"}, "sliding"), ({"rings": True}, "a tool of an")):
        lever = Lever(2, **options)
        lever.tool.drive_moment(-1.0)
        with pytest.raises(ValueError, match=f"drive_moment: {message}"):
            lever.problem.solve()
