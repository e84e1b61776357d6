"""Case 12: energy balance of a loading cycle, and of forging."""

import dataclasses

from mpi4py import MPI

import numpy as np
from forging import Parameters, build
from forging_bodies import E_DIE, HEIGHT, NU_DIE, SPEED
from forging_output import Energy
from hard.bodies import Punch, Wrong, iterations, solve
from hard.cases import SHORT, Case, Variant
from scenes import WORLD

import ufl
from dolfinx import fem

import qsdolfinx as qs


class Cycle:
    """A punch that is lowered and raised: work of its drive, and energy stored in the bodies."""

    def __init__(self, variant):
        self.scene = scene = Punch(variant, n=((16, 6), (7, 3)))
        self.problem, self.variant = scene.problem(), variant
        self.stored = [
            fem.form(0.5 * ufl.inner(b.stress, ufl.grad(b.u)) * ufl.dx) for b in scene.bodies
        ]
        self.height, self.force, self.work, self.size = 0.05, 0.0, 0.0, 0.0

    def to(self, height, steps):
        """Go to a height; the work is summed by the trapezoidal rule."""
        for h in np.linspace(self.height, height, steps + 1)[1:]:
            self.scene.height.value = h
            solve(self.problem)
            force = self.scene.contact.force("slave")[1]
            work = -0.5 * (force + self.force) * (h - self.height)
            self.work, self.size = self.work + work, self.size + abs(work)
            self.height, self.force = h, force

    def energy(self):
        """Return the energy stored in the bodies and, with a penalty, in contact. Collective."""
        contact = 0.0 if self.variant.augmented else self.scene.contact.stored_energy()
        return integrals(self.stored) + contact


def integrals(forms):
    return WORLD.allreduce(sum(fem.assemble_scalar(form) for form in forms), op=MPI.SUM)


def returned(variant):
    """All work is returned in a cycle, whatever the contact did."""
    cycle = Cycle(variant)
    for _ in range(3):
        cycle.to(-0.2, 10)
        cycle.to(0.05, 10)
    if not cycle.size > 0:
        raise Wrong("there was no work")
    return max(abs(cycle.work), cycle.energy()) / cycle.size


def stored(variant):
    """Work equals stored energy up to the order of the rule: 4 times less error, half the steps."""
    errors = []
    for steps in (16, 64):
        cycle = Cycle(variant)
        cycle.to(-0.2, steps)
        errors.append(abs(cycle.work / cycle.energy() - 1))
    if errors[1] > errors[0] / 4:
        raise Wrong(f"errors of {errors[0]:.1e} in 16 steps, of {errors[1]:.1e} in 64")
    return errors[1]


def forge(variant, steps):
    """Return the fraction of the work of forging that the energy balance does not account for.

    Flow and friction dissipate the work, dies and penalty store it. Backward Euler adds ½ Δu·K Δu
    to the stored energy in each step. In the first step, in which the force jumps, this addition
    equals the energy stored by then; later it is small. No addition depends on the length of steps.
    """
    p = dataclasses.replace(
        Parameters(),
        **variant.options,
        friction="coulomb-tresca",
        mu=0.3,
        m_bar=0.6,
        die_refinement=1.5,
        reduction=0.08,
        num_steps=steps,
    )
    work, dies, contacts, _, stepper = build(WORLD, p)
    energy = Energy(work, dies, contacts, SPEED)
    stepper.on_solved = energy.on_solved
    changes = [fem.Function(die.V) for die in dies]
    forms = [
        fem.form(
            0.5 * ufl.inner(qs.materials.linear_elastic(u, E_DIE, NU_DIE), ufl.grad(u)) * ufl.dx
        )
        for u in changes
    ]
    before = [die.u.x.array.copy() for die in dies]
    euler, penalty = 0.0, 0.0
    for _ in stepper.run(p.reduction * HEIGHT / SPEED):
        iterations.append(stepper.num_iterations)
        row = energy.row(abs(contacts[1].force("slave")[2]), stepper.last_dt)
        for change, die, u in zip(changes, dies, before, strict=True):
            change.x.array[:] = die.u.x.array - u
            u[:] = die.u.x.array
        euler += integrals(forms)
        if not variant.augmented:
            penalty = sum(contact.stored_energy() for contact in contacts)
            euler += penalty if stepper.num_steps == 1 else 0.0
    return abs(row["energy_error"] - (euler + penalty) / row["work"])


def cases(variant):
    name, once = "12 energy", variant == Variant()
    run = lambda: returned(variant)  # noqa: E731
    yield Case(name, "three elastic cycles", "work, energy", 1e-8, run, variant in SHORT)
    run = lambda: stored(variant)  # noqa: E731
    yield Case(name, "work against what is stored", "difference", 1e-2, run, once)
    if variant in (*SHORT, Variant("master-slave", "nodal")):
        for steps in (2, 4):
            run = lambda n=steps: forge(variant, n)  # noqa: E731
            yield Case(name, f"forging, {steps} steps", "missing work", 2e-3, run)
