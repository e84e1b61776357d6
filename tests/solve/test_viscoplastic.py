"""Norton-Hoff bodies between plates and in contact, and continuation in the rate sensitivity."""

import numpy as np
import pytest
from scenes import WORLD, box, largest, plane, raises_everywhere, slide

import ufl
from dolfinx import fem, la

import qsdolfinx as qs
from qsdolfinx import materials

KINDS = ("plane", "axisymmetric", "3D")
WIDTH, HEIGHT, K = 0.7, 1.3, 5.0


class Billet:
    """A Norton-Hoff body on a plane of symmetry, pressed from above by a plate.

    Args:
        kind: Plane strain, axisymmetric or 3D.
        n: Cells along each edge.
        sticking: Whether the body sticks to the plate.
        options: Options of PETSc.
    """

    def __init__(self, kind, n=2, sticking=False, options=None):
        self.axisymmetric, self.up = kind == "axisymmetric", 2 if kind == "3D" else 1
        cell = "tetrahedron" if kind == "3D" else "triangle"
        corner = [WIDTH] * self.up + [HEIGHT]
        self.msh = msh = box(WORLD, (n,) * (self.up + 1), cell, [0.0] * (self.up + 1), corner)
        W = materials.mini_space(msh)
        self.w = fem.Function(W)
        self.K, self.m, self.floor = (fem.Constant(msh, value) for value in (K, 1.0, 1e-3))
        v = ufl.split(self.w)[0]
        stress = materials.norton_hoff(v, self.K, self.m, self.floor, self.axisymmetric)
        self.F = materials.incompressible(self.w, stress)
        self.form = fem.form(self.F)
        self.velocity = fem.Constant(msh, 0.0)
        top, V = plane(msh, self.up, HEIGHT), W.sub(0)
        self.top_dofs = fem.locate_dofs_topological(V.sub(self.up), self.up, top)
        bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in range(self.up + 1)]
        bcs.append(fem.dirichletbc(self.velocity, self.top_dofs, V.sub(self.up)))
        if sticking:
            bcs += [slide(V, axis, top) for axis in range(self.up)]
        self.problem = qs.ContactProblem([self.F], [self.w], [], [bcs], petsc_options=options)

    def press(self, rate, floor=1e-3):
        """Set the ratio of velocity to height, and ε̇₀ as a fraction of it."""
        self.velocity.value, self.floor.value = -rate * HEIGHT, floor * rate

    def residual(self):
        """Residual without Dirichlet conditions, at the owned unknowns."""
        r = fem.assemble_vector(self.form)
        r.scatter_reverse(la.InsertMode.add)
        return r.array[: self.problem.bodies[0].num_owned]

    def force(self):
        """Force of the plate, positive in compression."""
        r = self.residual()
        return -WORLD.allreduce(r[self.top_dofs[self.top_dofs < r.size]].sum())

    def unbalanced(self):
        """Largest residual at free unknowns, relative to the largest reaction."""
        r = self.residual()
        return largest(r[self.problem.bodies[0].free]) / largest(r)

    def integral(self, expression):
        weight = materials.axisymmetric_weight(self.msh) if self.axisymmetric else 1.0
        return WORLD.allreduce(fem.assemble_scalar(fem.form(weight * expression * ufl.dx)))


@pytest.mark.parametrize("kind", KINDS)
def test_upsetting_force(kind):
    """The force is π R² K √3^{m+1} (V/h)^m for a cylinder, to 1e-6.

    In plane strain it is 2K (2 V/h)^m.
    """
    billet = Billet(kind)
    for m in (1.0, 0.5, 0.15, 0.05):
        for rate in (0.1, 1.0, 10.0):
            billet.press(rate)
            solved = qs.solve_with_continuation(billet.problem, billet.m, m)
            assert solved[-1][0] == 1.0 and billet.m.value == m
            assert all(n <= 3 for _, n in solved), solved
            if kind == "plane":
                force, equivalent = WIDTH * 2 * K * (2 * rate) ** m, 2 / np.sqrt(3) * rate
            else:
                area = np.pi * WIDTH**2 if billet.axisymmetric else WIDTH**2
                force, equivalent = area * K * np.sqrt(3) ** (m + 1) * rate**m, rate
            assert np.isclose(billet.force(), force, rtol=1e-6), (m, rate)
            force *= (1 + (1e-3 * rate / equivalent) ** 2) ** ((m - 1) / 2)
            assert np.isclose(billet.force(), force, rtol=1e-9), (m, rate)
    billet.problem.destroy()


@pytest.mark.parametrize("scale", (1e-6, 1e6))
def test_units(scale):
    """Convergence and force do not depend on the unit of stress."""
    billet = Billet("plane")
    billet.K.value *= scale
    for rate in (1.0, 2.0):  # the second starts from the first
        billet.press(rate)
        qs.solve_with_continuation(billet.problem, billet.m, 0.15)
        force = WIDTH * 2 * K * scale * (2 * rate) ** 0.15
        assert np.isclose(billet.force(), force, rtol=1e-6)
    billet.problem.destroy()


@pytest.mark.parametrize("kind", KINDS)
def test_sticking(kind):
    """With sticking: few iterations, forces in balance, no volume flux, and a larger force."""
    n = 4 if kind == "3D" else 8
    billet = Billet(kind, n, sticking=True)
    force = {}
    for m in (1.0, 0.5, 0.15, 0.05):
        for rate in (0.1, 1.0, 10.0):
            billet.w.x.array[:] = 0
            billet.press(rate)
            solved = qs.solve_with_continuation(billet.problem, billet.m, m)
            assert sum(count for _, count in solved) <= 30, (m, rate, solved)
            assert billet.unbalanced() < 1e-7, (m, rate, billet.unbalanced())
            # At m = 1 the rate is a factor of all results, and so it is for any m.
            force[m, rate] = billet.force() / rate**m
            assert np.isclose(force[m, rate], force[m, 0.1], rtol=1e-6)
    v = ufl.split(billet.w)[0]
    volume = billet.integral(ufl.tr(materials.strain(v, billet.axisymmetric)))
    assert abs(volume) < 1e-9 * billet.integral(ufl.sqrt(ufl.inner(v, v)))
    area = np.pi * WIDTH**2 if billet.axisymmetric else WIDTH**2
    frictionless = WIDTH * 2 * K * 2**0.05 if kind == "plane" else area * K * 3**0.525
    assert frictionless < force[0.05, 1.0] < 1.5 * frictionless
    billet.problem.destroy()


def test_later_steps():
    """Starting from the flow of the last step, no continuation is needed."""
    billet = Billet("plane", 6, sticking=True)
    billet.press(1.0, 1e-2)
    first = qs.solve_with_continuation(billet.problem, billet.m, 0.15)
    force = billet.force()
    again = qs.solve_with_continuation(billet.problem, billet.m, 0.15)
    assert len(first) == 3 and [s for s, _ in again] == [1.0] and again[0][1] <= 1
    assert np.isclose(billet.force(), force, rtol=1e-9)
    billet.velocity.value *= 1.05
    assert len(qs.solve_with_continuation(billet.problem, billet.m, 0.15)) == 1
    assert np.isclose(billet.force(), force * 1.05**0.15, rtol=1e-3)
    billet.problem.destroy()


def test_steps_are_halved():
    """If iterations are too few, continuation steps are halved; far too few are an error."""
    counts = []
    for max_it in (50, 6, 1):
        options = {"snes_max_it": max_it, "snes_linesearch_type": "bt"}
        billet = Billet("plane", 6, sticking=True, options=options)
        billet.press(1.0)
        if max_it > 1:
            counts.append(len(qs.solve_with_continuation(billet.problem, billet.m, 0.05)))
            assert billet.unbalanced() < 1e-7
        else:
            billet.w.x.array[:] = 1e-3
            billet.m.value = 0.7
            raises_everywhere(
                WORLD,
                qs.ConvergenceError,
                "MAX_IT",
                lambda: qs.solve_with_continuation(billet.problem, billet.m, 0.15),
            )
            assert billet.m.value == 0.7 and largest(billet.w.x.array - 1e-3) == 0
        billet.problem.destroy()
    assert counts[0] == 4 < counts[1], counts


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_contact(quadrature):
    """Two bodies of different m in frictionless contact: each flows at the rate of its stress."""
    bodies, m, targets, surfaces, eps = [], [], (0.5, 0.25), [], 1e4
    for low, high, n in ((0.0, 1.0, 3), (1.0, 2.0, 4)):
        msh = box(WORLD, (n, n), "triangle", [0.0, low], [1.0, high])
        W = materials.mini_space(msh)
        w = fem.Function(W)
        m.append(fem.Constant(msh, 1.0))
        stress = materials.norton_hoff(ufl.split(w)[0], 1.0, m[-1], 1e-4)
        V, far = W.sub(0), 0.0 if low == 0 else 2.0
        bcs = [slide(V, 0, plane(msh, 0, 0.0)), slide(V, 1, plane(msh, 1, far), -far / 2)]
        bodies.append((materials.incompressible(w, stress), w, bcs))
        surfaces.append(qs.Surface(V, facets=plane(msh, 1, 1.0)))
    contact = qs.Contact(
        surfaces[1],
        surfaces[0],
        penalty=eps,
        quadrature=quadrature,
        enforcement="penalty",
        sliding="small",  # the unknowns are rates
    )
    F, w, bcs = (list(given) for given in zip(*bodies, strict=True))
    problem = qs.ContactProblem(F, w, [contact], bcs)
    solved = qs.solve_with_continuation(problem, m, targets)
    assert solved[-1][0] == 1.0 and [constant.value for constant in m] == list(targets)
    # Both have the stress 2 (2a)^m; their rates and the relative velocity t/ε add up to the plate's
    # rate 1.
    stress = _root(lambda t: sum((t / 2) ** (1 / m) / 2 for m in targets) + t / eps - 1)
    for function, target in zip(w, targets, strict=True):
        v = ufl.split(function)[0]
        rate = (stress / 2) ** (1 / target) / 2
        error = (v[1].dx(1) + rate) ** 2
        error = WORLD.allreduce(fem.assemble_scalar(fem.form(error * ufl.dx)))
        assert np.sqrt(error) < (0.02 if quadrature == "nodal" else 1e-6) * rate
    problem.destroy()


def _root(function, low=0.0, high=100.0):
    """Root by bisection."""
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return middle
