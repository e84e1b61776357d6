"""Case 4: contact that recedes, is lost, comes back, and cycles without drift."""

from mpi4py import MPI

import numpy as np
from hard.scenes import (
    COMM,
    Body,
    Check,
    Column,
    Wrong,
    difference,
    largest,
    problem,
    solve,
    with_tags,
)
from hard.stiffness import Punch

from dolfinx import fem

import qsdolfinx as qs

CYCLES = 100


def small(variant, **options):
    return Punch(variant, n=((16, 6), (7, 3)), **options)


def cycles(variant):
    """Down, up and off, deeper down, half up: the same states in every cycle."""
    scene = small(variant)
    p = scene.problem()
    first, drift, iterations = [], 0.0, 0
    for cycle in range(CYCLES):
        for i, height in enumerate((-0.1, 0.3, -0.2, -0.05)):
            scene.height.value = height
            iterations = max(iterations, solve(p))
            state = [u.x.array.copy() for u in p.u]
            if cycle == 0:
                first.append(state)
            drift = max(drift, difference(p.u, first[i]))
    p.destroy()
    return drift, iterations


def receding(variant):
    """A layer on a block, pressed in the middle: it lifts off at its ends at once.

    Without gaps before, displacements and forces are as the load is: ten times the load, ten times
    the displacements, on the same part of the surface.
    """
    found = []
    for pressure in (1e-4, 1e-3):
        block = Body((25, 8), [0.0, -2.0], [6.0, 0.0])
        layer = Body((30, 2), [0.0, 0.0], [4.0, 0.5])
        block.clamp(block.facets(1, -2.0))
        for body in (block, layer):
            body.slide(0, body.facets(0, 0.0))
        layer.load(layer.facets(1, 0.5, lambda x: x[0] < 0.4 + 1e-9), [0.0, -pressure])
        surfaces = layer.surface(1, 0.0), block.surface(1, 0.0)
        contact = qs.Contact(*surfaces, gap_tolerance=1e-8 * pressure, **variant.options)
        p = problem((block, layer), [contact])
        iterations = solve(p)
        state = [u.x.array / pressure for u in p.u]
        area = contact.patch()[0]
        found.append((p, state, area, contact.force("slave")[1] / pressure, iterations))
    (_, a, area, _, _), (_, b, other, force, iterations) = found
    if not 0 < area < 3.9 or area != other:
        raise Wrong(f"contact on {area:.3g} and {other:.3g} of 4")
    change = largest(*(i - j for i, j in zip(a, b, strict=True))) / largest(*a)
    return max(change, abs(force / 0.4 - 1)), iterations


class Sprung:
    """The column, the upper end of which hangs in soft springs, and is pressed or pulled."""

    stiffness = 1e-3

    def __init__(self, variant):
        self.scene = Column(variant)
        self.upper = upper = self.scene.upper
        self.load = self.scene.press(0.0)
        ds = upper.measure(self.scene.top)
        upper.F += self.stiffness * upper.u[1] * upper.v[1] * ds
        tags = upper.tags()
        self._down = fem.form(with_tags(-upper.u[1] * ds, tags))
        self.problem = self.scene.problem()

    def solve(self, pressure):
        """Solve with the unknowns as they are; returns the error and the iterations.

        Pressed: contact and springs carry the load. Pulled: the body hangs in its springs, whole.
        """
        self.load.value[1] = -pressure
        iterations = solve(self.problem)
        if pressure < 0:
            up = self.upper.u.x.array[1::2]
            return largest(up * self.stiffness / pressure + 1), iterations
        springs = self.stiffness * COMM.allreduce(fem.assemble_scalar(self._down), op=MPI.SUM)
        force = self.scene.contact.force("slave")[1]
        return abs((force + springs) / pressure - 1), iterations


def reversal(variant):
    """Pressed, pulled off in one solve, pressed again from there, ten times."""
    scene = Sprung(variant)
    found = [scene.solve(p) for _ in range(10) for p in (1e-3, -1e-3, 2e-3, -2e-3)]
    return max(error for error, _ in found), max(count for _, count in found)


def thrown(variant):
    """The first guess is thrown up by half the height, upside down in part, or sunk in."""
    scene = Sprung(variant)
    scene.solve(1e-3)
    state = [u.x.array.copy() for u in scene.problem.u]
    errors, iterations = [], 0
    x = scene.upper.V.tabulate_dof_coordinates()
    for change in (0.5, -0.1, 0.3 * np.sin(40 * x[:, 0])):
        scene.upper.u.x.array[1::2] += change
        error, count = scene.solve(1e-3)
        errors += [error, difference(scene.problem.u, state)]
        iterations = max(iterations, count)
    return max(errors), iterations


def checks(variant):
    case = "4 lost and found"
    same = "displacements"
    yield Check(
        case, "receding contact", "displacements over load", 1e-8, lambda: receding(variant)
    )
    yield Check(case, f"{CYCLES} cycles on and off", "drift", 1e-8, lambda: cycles(variant))
    yield Check(case, "load reversed", "equilibrium", 1e-7, lambda: reversal(variant))
    yield Check(case, "thrown off and sunk in", same, 1e-8, lambda: thrown(variant))
