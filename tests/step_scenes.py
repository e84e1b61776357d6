"""Viscous and elastic blocks that are pressed step by step, for the tests."""

import numpy as np
from scenes import WORLD, box, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import multipliers

K, SPEED = 3.0, 1.0


class Upset:
    """A Newtonian block, 1 × 1, plane strain, between rigid planes without friction.

    Args:
        die: Whether an elastic die replaces the lower plane.
        held: Whether x = 0 is a plane of symmetry; otherwise only contact supports the block.
        stepping: Arguments of the TimeStepper.
        contact: Arguments of the contacts.
    """

    def __init__(
        self,
        comm=WORLD,
        die=False,
        held=True,
        n=3,
        dt=0.05,
        drive=True,
        solve=None,
        contact=None,
        partition=None,
        **stepping,
    ):
        self.mesh = box(comm, (n, n), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
        self.W = W = qs.materials.mini_space(self.mesh)
        self.w = fem.Function(W)
        V = W.sub(0)
        forms = [qs.materials.incompressible(self.w, self.stress())]
        bcs = [[slide(V, 0, plane(self.mesh, 0, 0.0))] if held else []]
        self.lower, self.upper = (qs.Surface(V, facets=plane(self.mesh, 1, z)) for z in (0.0, 1.0))
        self.tool = qs.RigidSurface.plane(comm, [0.0, 1.0], [0.0, -1.0])
        options = {"unknown": "velocity", "dt": dt, "enforcement": "augmented-lagrangian"}
        options |= contact or {}
        self.u = [self.w]
        if die:
            self.die_mesh = box(comm, (5, 2), "triangle", [-0.5, -1.0], [2.0, 0.0], partition)
            D = vector_space(self.die_mesh)
            self.u.append(fem.Function(D))
            forms.append(elastic(self.u[1], E=500.0))
            bcs.append([slide(D, i, plane(self.die_mesh, 1, -1.0)) for i in (0, 1)])
            master = qs.Surface(D, facets=plane(self.die_mesh, 1, 0.0))
        else:
            master = qs.RigidSurface.plane(comm, [0.0, 0.0], [0.0, 1.0])
        unknown = ("velocity", "displacement") if die else "velocity"
        self.contacts = [
            qs.Contact(self.lower, master, **(options | {"unknown": unknown})),
            qs.Contact(self.upper, self.tool, **options),
        ]
        self.problem = qs.ContactProblem(forms, self.u, self.contacts, bcs)
        self.stepper = qs.TimeStepper(
            self.problem, dt, self.move if drive is True else drive, solve=solve, **stepping
        )

    def stress(self):
        return qs.materials.newtonian(ufl.split(self.w)[0], K)

    def move(self, t, dt):
        self.tool.displacement = [0.0, -SPEED * dt]

    def size(self):
        """Return width and height of the block, which stays a rectangle. Collective."""
        x = self.mesh.geometry.x
        comm = self.mesh.comm
        return np.ptp(np.concatenate(comm.allgather(x[:, :2])), axis=0)

    def forces(self):
        return np.concatenate([c.force("slave") for c in self.contacts])

    def state(self):
        """Return all values that a failed step must leave unchanged."""
        arrays = [u.x.array for u in self.u] + [u.function_space.mesh.geometry.x for u in self.u]
        arrays += [m for c in self.contacts for m in multipliers.on_nodes(c.model.parts)]
        arrays += [self.tool.position, self.tool.displacement]
        return [a.copy() for a in arrays] + [np.array([self.stepper.t, self.stepper.num_steps])]


def same(first, second):
    """Return whether two states are equal, bit by bit, on all ranks."""
    equal = all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    return WORLD.allreduce(int(not equal)) == 0


def refuse(*history):
    """Raise the error of a solver that does not converge."""
    raise qs.ConvergenceError(-5, list(history), [])
