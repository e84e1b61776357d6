"""Found by independent users: results that depended on the start, moments, kinds of errors."""

import warnings

import numpy as np
import pytest
from following import Boxes, rotation
from scenes import WORLD, largest, plane

import qsdolfinx as qs
from qsdolfinx.contact import motion
from qsdolfinx.gap.no_value import NoGapError
from qsdolfinx.system.equations import Equations


@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
@pytest.mark.parametrize("enforcement", ("augmented-lagrangian", "penalty"))
@pytest.mark.parametrize("way", (0.35, 0.75))
def test_solve_again(way, enforcement, formulation):
    """A solve is the same from another start, where other nodes of a wide slave are covered."""
    scene = Boxes("quadrilateral", ((12, 4), (5, 4)), ((2.4, 1.0), (1.0, 1.0)), start=0.7)
    top = scene.clamp_far()
    options = {"sliding": "finite", "enforcement": enforcement}
    contact = qs.Contact(scene.below, scene.above, formulation=formulation, **options)
    problem = scene.problem(contact)
    top.value[:] = way, -0.03
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*where the solve began")
        problem.solve()
        first = contact.force("slave")
        problem.solve()
    assert largest(contact.force("slave") - first) < 1e-4 * largest(first)


@pytest.mark.parametrize("angle", (0.0, 0.5, 2.5))
def test_moment_of_a_tie(angle):
    """The moment of a tie is that of the forces on the deformed bodies, at any rotation."""
    scene = Boxes("quadrilateral", ((4, 3), (3, 3)), ((1.0, 1.0), (1.0, 1.0)), gap=0.05)
    lower, upper = scene.bodies
    lower.clamp(plane(lower.mesh, 1, -1.0))
    upper.clamp(plane(upper.mesh, 1, 1.05), (0.02, -0.03))
    options = {"sliding": "finite", "enforcement": "penalty", "law": qs.Tied()}
    contact = qs.Contact(scene.above, scene.below, formulation="master-slave", **options)
    problem = scene.problem(contact)
    problem.solve()
    before, force = contact.moment("slave", np.zeros(2)), contact.force("slave")
    x, f = upper.places, upper.internal_forces()
    free = np.abs(upper.V.tabulate_dof_coordinates()[: len(x), 1] - 0.05) < 1e-9
    own = WORLD.allreduce(float(np.sum((x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])[free])))
    assert abs(before[0] - own) < 1e-8 * np.abs(force).max()
    if angle:
        R = rotation(angle)
        for body in scene.bodies:  # the conditions hold the bottom at its place: no solve here
            x0 = body.V.tabulate_dof_coordinates()[:, :2]
            u = body.u.x.array.reshape(-1, 2)
            u[:] = (x0 + u) @ R.T - x0
        motion.show(contact.model, upper.u, lower.u)
        turned = contact.moment("slave", np.zeros(2))
        assert abs(turned[0] - before[0]) < 1e-8 * np.abs(force).max()


def test_gaps_that_cannot_be_measured(monkeypatch):
    """An iterate that goes too far is Newton's failure, and the message gives the reason."""
    scene = Boxes("quadrilateral")
    top = scene.clamp_far()
    contact = qs.Contact(scene.above, scene.below, sliding="finite")
    problem = scene.problem(contact)
    top.value[-1] = -0.01
    problem.set_up()

    def evaluate(self, z, *options, **more):
        if not np.array_equal(z, starts.setdefault("z", z)):
            raise NoGapError("rays that meet no point")
        return of_equations(self, z, *options, **more)

    starts, of_equations = {}, Equations.evaluate
    monkeypatch.setattr(Equations, "evaluate", evaluate)
    with pytest.raises(qs.ConvergenceError, match="meet no point"):
        problem.solve()


def test_edges_of_bodies():
    """The force of a block with named sides is that of its bottom alone."""
    forces = []
    for sides in ((), (0.7, 1.7)):
        scene = Boxes("quadrilateral", ((12, 4), (5, 4)), ((2.4, 1.0), (1.0, 1.0)), start=0.7)
        top, msh = scene.clamp_far(), scene.upper.mesh
        facets = np.concatenate([plane(msh, 1, 0.0), *(plane(msh, 0, x) for x in sides)])
        block = scene.upper.surface(np.unique(facets))
        options = {"sliding": "finite", "enforcement": "augmented-lagrangian"}
        contact = qs.Contact(block, scene.below, **options)
        problem = scene.problem(contact)
        top.value[:] = 0.1, -0.05
        problem.solve()
        forces.append(contact.force("slave"))
    assert largest(forces[1] - forces[0]) < 0.01 * largest(forces[0])
