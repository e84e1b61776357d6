"""Time steps with finite sliding of displacement-based and velocity-based bodies."""

import numpy as np
import pytest
from following import Boxes
from scenes import WORLD, box, clamp, elastic, largest, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.gap.no_value import NoGapError


def drag(steps, sliding, mu=0.2):
    """Press a block and drag it by 1.5 facets in time 2, in equal steps; return its force."""
    scene = Boxes("quadrilateral", ((12, 2), (5, 3)), ((2.4, 0.5), (1.0, 0.6)), start=0.53)
    top = scene.clamp_far()
    contact = qs.Contact(
        scene.above, scene.below, sliding=sliding, normals="facet", friction=qs.Coulomb(mu),
        enforcement="penalty", penalty=500.0,
    )  # fmt: skip
    problem = scene.problem(contact)

    def drive(t, dt):
        top.value[:] = 0.3 * max(t - 1, 0.0), -0.02 * min(t, 1.0)

    stepper = qs.TimeStepper(problem, 2 / steps, drive, dt_max=2 / steps)
    for _ in stepper.run(2.0):
        pass
    return contact.force("slave"), stepper


def test_bodies_in_displacements():
    """A few large steps with finite sliding agree with many small ones with small sliding."""
    limit, _ = drag(32, "small")
    found, stepper = drag(4, "finite")
    assert stepper.num_cutbacks == 0
    assert largest(found - limit) < 2e-2 * np.linalg.norm(limit)


def test_lost_rays_cut_steps_back():
    """A step in which rays from a curved facet find nothing is repeated with a smaller size."""
    scene = Boxes("quadrilateral", degree=2)
    top = scene.clamp_far()
    contact = qs.Contact(scene.above, scene.below, sliding="finite")
    problem, attempts = scene.problem(contact), []

    def drive(t, dt):
        top.value[1] = -0.01 * t

    def solve(step):
        attempts.append(step)
        if len(attempts) == 1:
            raise NoGapError("rays that meet no point")
        problem.solve()

    stepper = qs.TimeStepper(problem, 1.0, drive, solve=solve)
    assert next(iter(stepper.run(1.0))) == 0.5 and stepper.num_cutbacks == 1
    assert top.value[1] == -0.005


class Squeezed:
    """Viscous block, 1 × 1, on an elastic die; a rough tool slides over it and presses it down.

    Args:
        power_law: Whether the law is Norton-Hoff instead of Newtonian.
        penalty: ε; "auto" for an augmented Lagrangian.
    """

    def __init__(self, sliding, dt, power_law=False, penalty=300.0):
        msh = box(WORLD, (4, 4), "triangle", [0.0, 0.0], [1.0, 1.0])
        W = qs.materials.mini_space(msh)
        w = fem.Function(W)
        velocity = ufl.split(w)[0]
        stress = (
            qs.materials.norton_hoff(velocity, 3.0, 0.3, 1e-2)
            if power_law
            else qs.materials.newtonian(velocity, 3.0)
        )
        V = W.sub(0)
        die = box(WORLD, (9, 2), "triangle", [-0.7, -0.5], [2.3, 0.0])
        D = vector_space(die)
        d = fem.Function(D)
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        options = {
            "dt": dt,
            "sliding": sliding,
            "normals": "facet",
            "enforcement": "augmented-lagrangian" if penalty == "auto" else "penalty",
            "penalty": penalty,
        }
        self.contacts = [
            qs.Contact(
                qs.Surface(V, facets=plane(msh, 1, 0.0)),
                qs.Surface(D, facets=plane(die, 1, 0.0)),
                unknown=("velocity", "displacement"),
                friction=qs.Coulomb(0.3),
                **options,
            ),
            qs.Contact(
                qs.Surface(V, facets=plane(msh, 1, 1.0)),
                self.tool,
                unknown="velocity",
                friction=qs.Coulomb(0.1),
                **options,
            ),
        ]
        forms = [qs.materials.incompressible(w, stress), elastic(d, E=500.0)]
        bcs = [[slide(V, 0, plane(msh, 0, 0.0))], [clamp(D, plane(die, 1, -0.5))]]
        self.mesh = msh
        problem = qs.ContactProblem(forms, [w, d], self.contacts, bcs)
        self.stepper = qs.TimeStepper(problem, dt, self.move, dt_max=dt)

    def move(self, t, dt):
        self.tool.displacement = [0.2 * dt, -0.3 * dt]

    def run(self, t):
        for _ in self.stepper.run(t):
            pass
        return np.concatenate([contact.force("slave") for contact in self.contacts])

    @property
    def width(self):
        x = np.concatenate(WORLD.allgather(self.mesh.geometry.x))
        return np.ptp(x[:, 0])


@pytest.mark.parametrize("power_law", (False, True))
def test_bodies_in_velocities(power_law):
    """Both kinds of sliding converge to the same result for small steps."""
    widths = {}
    for sliding, dt in (("small", 0.0125), ("finite", 0.0125), ("finite", 0.05)):
        scene = Squeezed(sliding, dt, power_law)
        widths[sliding, dt] = np.append(scene.run(0.2), scene.width)
    limit, fine, coarse = widths.values()
    assert largest(fine - limit) < 2e-2 * np.abs(limit).max()
    assert largest(coarse - limit) < 8e-2 * np.abs(limit).max()


def test_order_of_steps():
    """With smaller steps a velocity-based block converges: two and four steps nearly agree."""
    one, two, four = (
        np.append(s.run(0.1), s.width) for s in (Squeezed("finite", 0.1 / n) for n in (1, 2, 4))
    )
    assert largest(two - four) < 0.8 * largest(one - four)


@pytest.mark.parallel
def test_tangent_after_a_step():
    """A check of a step assembles the tangent for other contact pairs: forces stay as they are.

    For velocity-based bodies and an augmented Lagrangian, the next solve has another penalty.
    """
    scene = Squeezed("finite", 0.05, power_law=True, penalty="auto")
    before = scene.run(0.1)
    problem = scene.stepper.problem
    assert not problem.system.fits_pattern()
    problem.newton.assemble()
    assert problem.system.fits_pattern()
    forces = np.concatenate([contact.force("slave") for contact in scene.contacts])
    np.testing.assert_array_equal(forces, before)
