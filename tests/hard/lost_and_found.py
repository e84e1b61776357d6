"""Case 4: contact that recedes, is lost, comes back, and cycles without drift."""

from mpi4py import MPI

import numpy as np
from hard.bodies import Column, Punch, Wrong, difference, problem, rectangle, solve
from hard.cases import SHORT, Case
from scenes import WORLD, largest

from dolfinx import fem

import qsdolfinx as qs

CYCLES = 100


def cycles(variant, number=CYCLES):
    """Down, up and off, deeper down, half up: the states of all cycles must agree."""
    scene = Punch(variant, n=((16, 6), (7, 3)))
    p, first, drift = scene.problem(), [], 0.0
    for _ in range(number):
        for i, height in enumerate((-0.1, 0.3, -0.2, -0.05)):
            scene.height.value = height
            solve(p)
            if len(first) == i:
                first.append([u.x.array.copy() for u in p.u])
            drift = max(drift, difference(p.u, first[i]))
    p.destroy()
    return drift


def receding(variant):
    """A layer on a block, pressed in the middle, lifts off at its ends immediately.

    Without initial gaps, displacements and forces are proportional to the load: ten times the load
    gives ten times the displacements, with contact on the same part of the surface.
    """
    states, areas = [], []
    for pressure in (1e-4, 1e-3):
        block = rectangle((25, 8), [0.0, -2.0], [6.0, 0.0])
        layer = rectangle((30, 2), [0.0, 0.0], [4.0, 0.5])
        block.hold(block.facets(1, -2.0))
        for body in (block, layer):
            body.hold(body.facets(0, 0.0), axis=0)
        layer.load(layer.facets(1, 0.5, lambda x: x[0] < 0.4 + 1e-9), [0.0, -pressure])
        surfaces = layer.surface(1, 0.0), block.surface(1, 0.0)
        contact = qs.Contact(*surfaces, gap_tolerance=1e-8 * pressure, **variant.options)
        p = problem((block, layer), [contact])
        solve(p)
        states.append([u.x.array / pressure for u in p.u])
        areas.append(contact.patch()[0])
        force = contact.force("slave")[1] / pressure
    if not 0 < areas[0] < 3.9 or areas[0] != areas[1]:
        raise Wrong(f"contact on {areas[0]:.3g} and {areas[1]:.3g} of 4")
    a, b = states
    change = largest(*(i - j for i, j in zip(a, b, strict=True))) / largest(*a)
    return max(change, abs(force / 0.4 - 1))


class Sprung:
    """The column, with its upper end on soft springs, under pressure or tension."""

    stiffness = 1e-3

    def __init__(self, variant):
        self.scene = Column(variant)
        self.upper = upper = self.scene.upper
        self.load = self.scene.press(0.0)
        upper.F += self.stiffness * upper.u[1] * upper.v[1] * upper.loaded
        self.down = fem.form(-upper.u[1] * upper.loaded)
        self.problem = self.scene.problem()

    def error(self, pressure):
        """Solve from the present unknowns; return the equilibrium error of the load.

        Under pressure, contact and springs carry the load; under tension only the springs do, and
        the body moves as a rigid body.
        """
        self.load.value[1] = -pressure
        solve(self.problem)
        if pressure < 0:
            return largest(self.upper.u.x.array[1::2] * self.stiffness / pressure + 1)
        springs = self.stiffness * WORLD.allreduce(fem.assemble_scalar(self.down), op=MPI.SUM)
        return abs((self.scene.contact.force("slave")[1] + springs) / pressure - 1)


def reversal(variant):
    """Pressed, pulled off in one solve, pressed again from there, ten times."""
    scene = Sprung(variant)
    return max(scene.error(p) for _ in range(10) for p in (1e-3, -1e-3, 2e-3, -2e-3))


def thrown(variant):
    """The initial guess is moved up by half the height, wavy, or penetrating."""
    scene = Sprung(variant)
    scene.error(1e-3)
    state, errors = [u.x.array.copy() for u in scene.problem.u], []
    x = scene.upper.V.tabulate_dof_coordinates()
    for change in (0.5, -0.1, 0.3 * np.sin(40 * x[:, 0])):
        scene.upper.u.x.array[1::2] += change
        errors += [scene.error(1e-3), difference(scene.problem.u, state)]
    return max(errors)


def cases(variant):
    for label, what, allowed, run in (
        ("receding contact", "displacements over load", 1e-8, receding),
        (f"{CYCLES} cycles on and off", "drift", 1e-8, cycles),
        ("load reversed", "equilibrium", 1e-7, reversal),
        ("thrown off and sunk in", "displacements", 1e-8, thrown),
    ):
        short = variant in SHORT and run is not cycles
        yield Case("4 lost and found", label, what, allowed, lambda run=run: run(variant), short)
