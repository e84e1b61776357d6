"""Case 11: incompressible viscoplastic flow at m = 0.05, at rest, and with a jump of the rate.

A Norton-Hoff block of height and width 1 is pressed with a velocity V on an elastic die of the same
width, which is guided at its sides. Flow is homogeneous: with the rate r, the pressure on the die
is 4 K (4 r² + 3 ε̇₀²)^((m−1)/2) r, and r follows from V and how far the die, and the penalty, give.
"""

import numpy as np
from hard.kit import Body, lattice
from hard.scenes import NU, Check, largest, solve

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

K, M, PUSH, E_DIE = 2.0, 0.05, 1e-2, 1e5
SLOW, FAST = 1e-3, 1e3


class Upsetting:
    """The block, in velocity and pressure, on its die."""

    def __init__(self, kind, floor=1e-3 * SLOW):
        n = (4, 5) if kind.quadrature == "overlay" else (4, 4)
        self.kind, self.floor = kind, floor
        lines = np.linspace(0, 1, n[0] + 1)
        msh = lattice("triangle", lines, lines)
        W = qs.materials.mini_space(msh)
        self.w, self.m = fem.Function(W), fem.Constant(msh, 1.0)
        stress = qs.materials.norton_hoff(ufl.split(self.w)[0], K, self.m, floor)
        V, self.top = W.sub(0), fem.Constant(msh, 0.0)
        find = lambda axis, at: mesh.locate_entities_boundary(  # noqa: E731
            msh, 1, lambda x: np.abs(x[axis] - at) < 1e-9
        )
        bcs = [
            fem.dirichletbc(
                value, fem.locate_dofs_topological(V.sub(axis), 1, find(axis, at)), V.sub(axis)
            )
            for axis, at, value in ((0, 0.0, fem.Constant(msh, 0.0)), (1, 1.0, self.top))
        ]
        die = Body(
            lattice("quadrilateral", np.linspace(0, 1, n[1] + 1), np.linspace(-1, 0, 3)), E_DIE
        )
        for side in (0.0, 1.0):
            die.hold(die.at(0, side), axis=0)
        die.hold(die.at(1, -1.0), axis=1)
        options = kind._asdict() | {"unknown": ("velocity", "displacement"), "dt": PUSH}
        if kind.enforcement != "penalty":
            options["gap_tolerance"] = 1e-10
        else:  # the automatic one is that of the rate it is first seen at
            options["penalty"] = E_DIE
        self.contact = qs.Contact(
            qs.Surface(V, facets=find(1, 0.0)), qs.Surface(die.V, facets=die.at(1, 0.0)), **options
        )
        self.problem = qs.ContactProblem(
            [qs.materials.incompressible(self.w, stress), die.F],
            [self.w, die.u],
            [self.contact],
            [bcs, die.bcs],
        )

    def flow(self, velocity):
        """Solve for a velocity of the upper end, from the state at hand; iterations."""
        self.top.value = -velocity
        self.contact.set_dt(PUSH / velocity)
        solved = qs.solve_with_continuation(self.problem, self.m, M)
        return sum(count for _, count in solved)

    def error(self, velocity):
        """Of the pressure, from the rate that it leaves to the block."""
        pressure = self.contact.force("slave")[1]
        give = (1 + NU) * (1 - 2 * NU) / (1 - NU) / E_DIE
        if self.kind.enforcement == "penalty":
            give += 1 / self.contact.penalty
        rate = velocity - pressure * give * velocity / PUSH
        expected = 4 * K * (4 * rate**2 + 3 * self.floor**2) ** ((M - 1) / 2) * rate
        return abs(pressure / expected - 1)


def steady(kind):
    """From rest to a steady rate."""
    scene = Upsetting(kind, 1e-3)
    iterations = scene.flow(1.0)
    error = scene.error(1.0)
    scene.problem.destroy()
    return error, iterations


def at_rest(kind):
    """Nothing moves, at m = 0.05 and from nothing: no velocity, no force."""
    scene = Upsetting(kind)
    scene.m.value = M
    iterations = solve(scene.problem)
    error = max(largest(u.x.array) for u in scene.problem.u)
    error = max(error, largest(scene.contact.force("slave")))
    scene.problem.destroy()
    return error, iterations


def jump(kind):
    """The rate jumps by 1e6, and back, from the state before."""
    scene = Upsetting(kind)
    errors, counts = [], []
    for velocity in (SLOW, FAST, SLOW):
        counts.append(scene.flow(velocity))
        errors.append(scene.error(velocity))
    scene.problem.destroy()
    return max(errors), max(counts)


def checks(kind):
    """Case 11."""
    for label, run in (("m = 0.05", steady), ("rate jump of 1e6 and back", jump)):
        yield Check("11 flow", label, "pressure", 1e-6, lambda f=run: f(kind))
    yield Check("11 flow", "at rest", "velocity and force", 1e-12, lambda: at_rest(kind))
