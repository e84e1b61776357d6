"""Case 12: the work of a loading cycle, and that of forging."""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np
from hard.scenes import COMM, Check, Variant, Wrong, solve
from hard.stiffness import Punch

import ufl
from dolfinx import fem

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "demos"))

from forging import E_DIE, HEIGHT, NU_DIE, SPEED, Parameters, build
from forging_output import Energy

import qsdolfinx as qs

#: Variants that forging, in 3D, is run with.
FORGED = (
    Variant("quasi-symmetric", "overlay", "penalty"),
    Variant("quasi-symmetric", "overlay", "augmented-lagrangian"),
    Variant("quasi-symmetric", "nodal", "penalty"),
    Variant("master-slave", "nodal", "penalty"),
)


class Cycle:
    """A punch that is lowered and raised: what its drive does, and what the bodies store."""

    def __init__(self, variant):
        self.scene = scene = Punch(variant, n=((16, 6), (7, 3)))
        self.problem, self.variant = scene.problem(), variant
        self.stored = [
            fem.form(0.5 * ufl.inner(b.stress, ufl.grad(b.u)) * ufl.dx) for b in scene.bodies
        ]
        self.height, self.force, self.work, self.size, self.iterations = 0.05, 0.0, 0.0, 0.0, 0

    def to(self, height, steps):
        """Go to a height; the work is found with the trapezoidal rule."""
        for h in np.linspace(self.height, height, steps + 1)[1:]:
            self.scene.height.value = h
            self.iterations = max(self.iterations, solve(self.problem))
            force = self.scene.contact.force("slave")[1]
            work = -0.5 * (force + self.force) * (h - self.height)
            self.work, self.size = self.work + work, self.size + abs(work)
            self.height, self.force = h, force

    def energy(self):
        """Stored by the bodies and, with a penalty, by the contact. Collective."""
        local = sum(fem.assemble_scalar(form) for form in self.stored)
        contact = 0.0 if self.variant.augmented else self.scene.contact.energy
        return COMM.allreduce(local, op=MPI.SUM) + contact


def returned(variant):
    """All work comes back, whatever the contact did on the way."""
    cycle = Cycle(variant)
    for _ in range(3):
        cycle.to(-0.2, 10)
        cycle.to(0.05, 10)
    if not cycle.size > 0:
        raise Wrong("there was no work")
    return max(abs(cycle.work), cycle.energy()) / cycle.size, cycle.iterations


def stored(variant):
    """The work is what is stored, to the order of the rule: 4 times less with half the steps."""
    errors = []
    for steps in (16, 64):
        cycle = Cycle(variant)
        cycle.to(-0.2, steps)
        errors.append(abs(cycle.work / cycle.energy() - 1))
    if errors[1] > errors[0] / 4:
        raise Wrong(f"errors of {errors[0]:.1e} in 16 steps, of {errors[1]:.1e} in 64")
    return errors[1], cycle.iterations


def forge(variant, steps):
    """Part of the work of forging that is nowhere to be found.

    Flow and friction dissipate it, dies and penalty store it. Backward Euler takes another
    ½ Δu·K Δu in each step for what is stored: as much as is stored by then in the first step, in
    which the force jumps, and little later on; none of it depends on the length of steps.
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
    work, dies, contacts, _, stepper = build(COMM, p)
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
    iterations, euler, penalty = 0, 0.0, 0.0
    for _ in stepper.run(p.reduction * HEIGHT / SPEED):
        push = abs(contacts[1].force("slave")[2])
        row = energy.row(push, stepper.last_dt)
        iterations = max(iterations, stepper.num_iterations)
        for change, die, u in zip(changes, dies, before, strict=True):
            change.x.array[:] = die.u.x.array - u
            u[:] = die.u.x.array
        euler += sum(COMM.allreduce(fem.assemble_scalar(form), op=MPI.SUM) for form in forms)
        if not variant.augmented:
            penalty = sum(contact.energy for contact in contacts)
            euler += penalty if stepper.num_steps == 1 else 0.0
    return abs(row["energy_error"] - (euler + penalty) / row["work"]), iterations


def checks(variant):
    case = "12 energy"
    yield Check(case, "three elastic cycles", "work, energy", 1e-8, lambda: returned(variant))
    yield Check(case, "work against what is stored", "difference", 1e-2, lambda: stored(variant))
    if variant in FORGED:
        for steps in (2, 4):
            label = f"forging, {steps} steps"
            yield Check(case, label, "missing work", 2e-3, lambda n=steps: forge(variant, n))
