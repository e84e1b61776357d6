"""Unsupported bodies: the loss of contact is not silent."""

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, problem_of, ring
from scenes import WORLD, box, plane, slide

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.solve import problem as solving
from qsdolfinx.solve.lost import is_a_body_lost


class Rolled:
    """A ring between two elastic blocks, with friction; it has no other support."""

    def __init__(self, sliding, facets=36):
        self.ring = Body(ring((facets, 3), (0.3, 1.0)), stiffness=1e3)
        self.rim = self.ring.boundary(lambda x: np.abs(np.hypot(x[0], x[1]) - 1) < 1e-2)
        self.blocks, self.tops = [], []
        for n, low, high, held, partition in (
            (30, -1.8, -1.0, -1.8, "last"),  # the other ranks have no facet of it
            (34, 1.0, 1.8, 1.8, "scattered"),
        ):
            msh = box(WORLD, (n, 4), "quadrilateral", [-3.0, low], [3.0, high], partition)
            body = Body(msh, stiffness=1e3)
            self.tops.append(body.clamp(plane(body.mesh, 1, held)))
            self.blocks.append((body, body.side(1, high if held == low else low)))
        self.bodies = [self.ring, *(body for body, _ in self.blocks)]
        self.contacts = [
            qs.Contact(self.ring.surface(self.rim), face, friction=qs.Coulomb(0.3), sliding=sliding)
            for _, face in self.blocks
        ]
        self.problem = qs.ContactProblem(
            [b.F for b in self.bodies],
            [b.u for b in self.bodies],
            self.contacts,
            [b.bcs for b in self.bodies],
        )

    def press(self, amount):
        self.tops[1].value[1] = -amount

    @property
    def place(self):
        """Mean displacement of the ring. Collective."""
        u, one = self.ring.u, fem.Constant(self.ring.mesh, 1.0)
        forms = [fem.form(f * ufl.dx) for f in (u[0], u[1], one)]
        *sums, area = (WORLD.allreduce(fem.assemble_scalar(form)) for form in forms)
        return np.array(sums) / area


@pytest.mark.parametrize("sliding", [pytest.param("finite", marks=pytest.mark.long), "small"])
def test_ring_between_blocks_stays(sliding):
    """The ring is pressed by 0.1 in five steps; its centre goes down by half of that."""
    scene = Rolled(sliding)
    stepper = qs.TimeStepper(scene.problem, 1.0, lambda t, dt: scene.press(0.02 * t))
    forces = [0.0]
    for _ in stepper.run(5.0):
        forces.append(scene.contacts[0].force("slave")[1])
        assert scene.contacts[1].force("slave")[1] == pytest.approx(-forces[-1], rel=1e-6)
    assert np.all(np.diff(forces) > 0)
    np.testing.assert_allclose(scene.place, [0.0, -0.05], atol=5e-3)


def test_lost_body_is_refused(monkeypatch):
    """If stabilisation does not help, an error is raised and the state is as before."""
    scene = Rolled("small")
    scene.press(0.02)
    monkeypatch.setattr(solving, "is_a_body_lost", lambda system, start: True)
    with pytest.raises(qs.ConvergenceError, match="BODY_LOST"):
        scene.problem.solve()
    assert np.all(scene.ring.u.x.array == 0)


def test_body_that_is_let_go():
    """A tool that moves back removes all forces; the body may stay anywhere without an error."""
    body = Body(box(WORLD, (3, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0]))
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    lid = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    contacts = [
        qs.Contact(body.side(1, y), tool, friction=qs.Coulomb(0.3))
        for y, tool in ((0.0, floor), (1.0, lid))
    ]
    problem = qs.ContactProblem([body.F], [body.u], contacts)
    for down in (0.05, -0.5):
        lid.displacement = [0.0, -down]
        problem.solve()
    for contact in contacts:
        assert np.abs(contact.force("slave")).max() < 1e-6


@pytest.mark.parametrize("shape", ["plane", "circle"])
def test_depth_before_a_tool_that_is_followed(shape):
    """In time steps the penetration refers to the current position of the tool."""
    body = Body(box(WORLD, (6, 3), "quadrilateral", [0.0, -1.0], [2.0, 0.0]), stiffness=1e3)
    body.clamp(plane(body.mesh, 1, -1.0))
    start = 0.01
    if shape == "plane":
        tool = qs.RigidSurface.plane(WORLD, [1.0, start], [0.0, -1.0])
    else:
        tool = qs.RigidSurface.cylinder(WORLD, [1.0, start + 0.8], None, 0.8)
    surface = body.side(1, 0.0)
    contact = qs.Contact(surface, tool, sliding="finite", enforcement="penalty", search_radius=0.3)
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])

    def drive(t, dt):
        tool.displacement = [0.0, -0.05 * dt]

    for t in qs.TimeStepper(problem, 0.25, drive).run(1.0):
        x, low = body.places, start - 0.05 * t
        depth = x[:, 1] - low
        if shape == "circle":
            depth = 0.8 - np.linalg.norm(x - [1.0, low + 0.8], axis=1)
        deepest = WORLD.allreduce(depth.max(initial=0.0), op=MPI.MAX)
        assert contact.penetration() >= deepest * (1 - 1e-9)
        assert contact.penetration() <= 1.5 * deepest + 1e-12
    assert deepest > 1e-3


@pytest.mark.parametrize("held", (True, False))
def test_lost_along_a_condition(held):
    """A plate on rollers, held along them by friction alone, is lost if drawn out under a block."""
    plate = Body(box(WORLD, (6, 2), "quadrilateral", [0.0, -0.5], [1.0, 0.0]))
    block = Body(box(WORLD, (3, 2), "quadrilateral", [0.2, 0.0], [0.8, 0.5]))
    plate.bcs.append(slide(plate.V, 1, plane(plate.mesh, 1, -0.5)))
    if held:
        plate.bcs.append(slide(plate.V, 0, plane(plate.mesh, 0, 0.0)))
    block.clamp(plane(block.mesh, 1, 0.5)).value[1] = -0.02
    contact = qs.Contact(block.side(1, 0.0), plate.side(1, 0.0), friction=qs.Coulomb(0.3))
    problem = problem_of([plate, block], [contact])
    problem.solve()
    system = problem.system
    start = system.x.array_r.copy()
    assert not is_a_body_lost(system, start)
    away = start.copy()
    system.parts(away)[0][0::2] += 3.0
    system.x.array[:] = away
    system.residual(away)
    assert is_a_body_lost(system, start) != held
