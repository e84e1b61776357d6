"""Case 11: incompressible viscoplastic flow at m = 0.05, at rest, and with a jump of the rate.

A Norton-Hoff block of height and width 1 is pressed with a velocity V on an elastic die of the same
width, which is guided at its sides. The flow is homogeneous: at the rate r, the pressure on the die
is 4 K (4 r² + 3 ε̇₀²)^((m−1)/2) r. r follows from V and the deformation of the die and of the
penalty.
"""

import numpy as np
from hard.bodies import Body, iterations, lattice, modulus, solve
from hard.cases import Case, Variant
from scenes import largest, plane, slide

import ufl
from dolfinx import fem

import qsdolfinx as qs

K, M, PUSH, E_DIE = 2.0, 0.05, 1e-2, 1e5
SLOW, FAST = 1e-3, 1e3


class Upsetting:
    """The block, with velocity and pressure as unknowns, on its die."""

    def __init__(self, variant, floor=1e-3 * SLOW):
        self.variant, self.floor = variant, floor
        lines = np.linspace(0, 1, 5)
        msh = lattice("triangle", lines, lines)
        W = qs.materials.mini_space(msh)
        self.w, self.m = fem.Function(W), fem.Constant(msh, 1.0)
        stress = qs.materials.norton_hoff(ufl.split(self.w)[0], K, self.m, floor)
        self.top = fem.Constant(msh, 0.0)
        V, Vy = W.sub(0), W.sub(0).sub(1)
        dofs = fem.locate_dofs_topological(Vy, 1, plane(msh, 1, 1.0))
        bcs = [slide(V, 0, plane(msh, 0, 0.0)), fem.dirichletbc(self.top, dofs, Vy)]
        lines = np.linspace(0, 1, 6 if variant.quadrature == "overlay" else 5)
        die = Body(lattice("quadrilateral", lines, np.linspace(-1, 0, 3)), E_DIE)
        for side in (0.0, 1.0):
            die.hold(die.facets(0, side), axis=0)
        die.hold(die.facets(1, -1.0), axis=1)
        # The automatic penalty belongs to the rate of the first solve.
        given = {"gap_tolerance": 1e-10} if variant.augmented else {"penalty": E_DIE}
        self.contact = qs.Contact(
            qs.Surface(V, facets=plane(msh, 1, 0.0)),
            die.surface(1, 0.0),
            unknown=("velocity", "displacement"),
            dt=PUSH,
            **variant.options | given,
        )
        self.problem = qs.ContactProblem(
            [qs.materials.incompressible(self.w, stress), die.F],
            [self.w, die.u],
            [self.contact],
            [bcs, die.bcs],
        )

    def error(self, velocity):
        """Solve for a velocity of the upper end, from the present state; return the error."""
        self.top.value = -velocity
        self.contact.set_dt(PUSH / velocity)
        solved = qs.solve_with_continuation(self.problem, self.m, M)
        iterations.append(sum(count for _, count in solved))
        pressure = self.contact.force("slave")[1]
        give = 1 / modulus(E_DIE) + (0.0 if self.variant.augmented else 1 / self.contact.penalty)
        rate = velocity - pressure * give * velocity / PUSH
        expected = 4 * K * (4 * rate**2 + 3 * self.floor**2) ** ((M - 1) / 2) * rate
        return abs(pressure / expected - 1)


def steady(variant):
    """Go from rest to a steady rate."""
    return Upsetting(variant, 1e-3).error(1.0)


def at_rest(variant):
    """No velocity and no force if nothing moves, at m = 0.05 and from a zero initial guess."""
    scene = Upsetting(variant)
    scene.m.value = M
    solve(scene.problem)
    return largest(*(u.x.array for u in scene.problem.u), scene.contact.force("slave"))


def jump(variant):
    """The rate jumps by 1e6, and back, starting from the previous state."""
    scene = Upsetting(variant)
    return max(scene.error(velocity) for velocity in (SLOW, FAST, SLOW))


def cases(variant):
    some = variant in (Variant(), Variant("quasi-symmetric", "nodal", "augmented-lagrangian"))
    for label, what, allowed, run in (
        ("m = 0.05", "pressure", 1e-6, steady),
        ("rate jump of 1e6 and back", "pressure", 1e-6, jump),
        ("at rest", "velocity and force", 1e-12, at_rest),
    ):
        yield Case("11 flow", label, what, allowed, lambda run=run: run(variant), some)
