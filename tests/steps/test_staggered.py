"""Heat after motion in time steps: order in time, frictional heat, and restored states."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, largest, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials


class Billet:
    """A Norton-Hoff billet between frictionless planes, which softens as it heats up.

    Insulated it deforms uniformly: ε̇ = V/h, and c dT/dt = β √3^{m+1} K₀ e^{−a T} ε̇^{m+1}, so that
    e^{aT} = 1 + a β √3^{m+1} K₀ V^m (h^{−m} − h₀^{−m}) / (c m).
    """

    K, m, a, c, share, speed = 2.0, 0.5, 0.4, 1.5, 0.9, 1.0

    def __init__(self, with_bad_heat=False):
        msh = self.mesh = box(WORLD, (2, 2, 2), "tetrahedron", [0.0] * 3, [1.0] * 3)
        W = materials.mini_space(msh)
        w = self.w = fem.Function(W)
        V = fem.functionspace(msh, ("Lagrange", 1))
        T, before = self.T, self.before = fem.Function(V), fem.Function(V)
        v = ufl.split(w)[0]
        stress = materials.norton_hoff(v, self.K * ufl.exp(-self.a * before), self.m, 1e-6)
        bcs = [slide(W.sub(0), axis, plane(msh, axis, 0.0)) for axis in range(3)]
        self.die = qs.RigidSurface.plane(WORLD, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
        surface = qs.Surface(W.sub(0), facets=plane(msh, 2, 1.0))
        contact = qs.Contact(surface, self.die, unknown="velocity", dt=0.1)
        w.sub(0).interpolate(lambda x: np.array([0.5 * x[0], 0.5 * x[1], -x[2]]))
        self.problem = qs.ContactProblem(
            [materials.incompressible(w, stress)], [w], [contact], [bcs]
        )
        dt = fem.Constant(msh, 0.1)
        source = materials.plastic_heat(stress, v, self.share)
        heat = materials.heat(T, 1.0, self.c, before, dt, source)
        if with_bad_heat:
            none = ufl.conditional(ufl.gt(dt, 0.03), 1e6, 0.0) * (1.0 + T**2)
            heat += none * ufl.TestFunction(V) * ufl.dx
        few = {"snes_max_it": 8} if with_bad_heat else {}  # it would iterate for long
        problem = qs.ContactProblem([heat], [T], [], petsc_options=few)
        self.staggered = qs.Staggered(problem, [before], dt)

    def stepper(self, dt):
        def drive(t, dt):
            self.die.displacement = [0.0, 0.0, -self.speed * dt]

        return qs.TimeStepper(self.problem, dt, drive, staggered=self.staggered)

    def exact(self, t):
        h = 1.0 - self.speed * t
        factor = self.share * np.sqrt(3.0) ** (self.m + 1) * self.K / (self.c * self.m)
        rise = factor * self.speed**self.m * (h**-self.m - 1.0)
        return np.log(1.0 + self.a * rise) / self.a

    def mean(self):
        volume = WORLD.allreduce(fem.assemble_scalar(fem.form(1.0 * ufl.dx(self.mesh))))
        return WORLD.allreduce(fem.assemble_scalar(fem.form(self.T * ufl.dx))) / volume


def test_order_in_time():
    """The isothermal split is of first order in time."""
    errors = []
    for steps in (4, 8, 16):
        billet = Billet()
        for _ in billet.stepper(0.3 / steps).run(0.3):
            pass
        errors.append(abs(billet.mean() - billet.exact(0.3)))
        np.testing.assert_array_equal(billet.before.x.array, billet.T.x.array)
    assert errors[-1] < 0.05 * billet.exact(0.3)
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 1.0, atol=0.2)


def test_failure_of_the_heat_cuts_the_step_back():
    """If the heat problem cannot be solved for a large Δt, smaller steps are made."""
    billet = Billet(with_bad_heat=True)
    stepper = billet.stepper(0.04)
    stepper.step()
    assert stepper.num_cutbacks == 1 and stepper.last_dt == pytest.approx(0.02)
    assert stepper.t == pytest.approx(0.02)
    first = stepper.num_iterations  # all of the step, with its failed attempt
    stepper.step()
    assert stepper.total_iterations == first + stepper.num_iterations > first > 0


def test_what_ends_a_step_after_the_heat_leaves_no_trace():
    """A step that is refused after all solves leaves no trace: the next step is as a first step."""

    def refuse():
        raise LookupError("refused")

    found = []
    for is_refused in (False, True):
        billet = Billet()
        stepper = billet.stepper(0.05)
        if is_refused:
            stepper.on_solved = refuse
            with pytest.raises(LookupError, match="refused"):
                stepper.step()
            stepper.on_solved = None
        stepper.step()
        found.append(billet.T.x.array.copy())
    assert largest(found[0]) > 0.01
    assert largest(found[1] - found[0]) < 1e-10 * largest(found[0])


def test_heat_of_friction_in_steps():
    """All energy dissipated by friction becomes heat, over all steps of one block on another."""
    u, T, before, forms, heat, bcs, surfaces, fields = ([] for _ in range(8))
    dt = []
    for i in range(2):
        msh = box(WORLD, (5 - i, 3), "triangle", [0.0, float(i)], [2.0 - i, i + 1.0])
        W, V = vector_space(msh), fem.functionspace(msh, ("Lagrange", 1))
        u.append(fem.Function(W))
        T.append(fem.Function(V))
        before.append(fem.Function(V))
        forms.append(elastic(u[i], E=100.0))
        dt.append(fem.Constant(msh, 1.0))
        heat.append(materials.heat(T[i], 1.0, 2.0 + i, before[i], dt[i]))
        end = plane(msh, 1, 2.0 * i)
        bcs.append([slide(W, axis, end) for axis in range(2)])
        facets = plane(msh, 1, 1.0)
        surfaces.append(qs.Surface(W, facets=facets))
        fields.append(qs.Surface(V, facets=facets))
    bodies = qs.Contact(surfaces[1], surfaces[0], friction=qs.Coulomb(0.3))
    law = qs.Conductance(0.5, friction=0.4)
    across = qs.Contact(fields[1], fields[0], law=law, mechanics=bodies, dt=1.0)

    def drive(t, dt):
        bcs[1][0].g.value[...] = 0.5 * t
        bcs[1][1].g.value[...] = -0.05

    problem = qs.ContactProblem(forms, u, [bodies], bcs)
    staggered = qs.Staggered(qs.ContactProblem(heat, T, [across]), before, dt)
    for _ in qs.TimeStepper(problem, 0.25, drive, staggered=staggered).run(1.0):
        pass
    stored = [
        WORLD.allreduce(fem.assemble_scalar(fem.form((2.0 + i) * T[i] * ufl.dx))) for i in range(2)
    ]
    assert bodies.dissipated_energy() > 0.1
    assert sum(stored) == pytest.approx(bodies.dissipated_energy(), rel=1e-9)


def test_refused():
    billet = Billet()
    other = fem.Function(fem.functionspace(billet.mesh, ("Lagrange", 2)))
    with pytest.raises(ValueError, match="before: must be in the spaces"):
        qs.Staggered(billet.staggered.problem, [other])
    with pytest.raises(ValueError, match="before: must have one Function"):
        qs.Staggered(billet.staggered.problem, [])
    with pytest.raises(TypeError, match=r"staggered: must be a qs\.Staggered"):
        qs.TimeStepper(billet.problem, 0.1, staggered=billet.staggered.problem)
