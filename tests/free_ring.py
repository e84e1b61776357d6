"""A ring supported by two plates only: squeezed, then rolled by the upper plate."""

import numpy as np
from scenes import WORLD, create_mesh

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

INNER, SQUEEZE = 0.6, 0.3


class FreeRing:
    """A neo-Hookean ring of radius 1 in plane strain, in time steps: squeezed, then rolled.

    Args:
        n: Numbers of cells around and across the ring.
        turn: Angle (degrees) by which it rolls per unit of time.
        stabilisation: Argument of the problem.
        constraints: Argument of the contacts.
        stepping: Arguments of the TimeStepper.
    """

    def __init__(self, n=(80, 4), turn=30.0, stabilisation=None, constraints="nodes", **stepping):
        angle = np.linspace(0, 2 * np.pi, n[0], endpoint=False)
        radius = np.linspace(INNER, 1.0, n[1] + 1)
        x = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=2)
        i, j = np.meshgrid(np.arange(n[0]), np.arange(n[1]), indexing="ij")
        k, right = i + n[0] * j, (i + 1) % n[0] + n[0] * j
        cells = np.stack([k, right, k + n[0], right + n[0]], axis=2).reshape(-1, 4)
        mine = np.array_split(np.arange(len(cells)), WORLD.size)[WORLD.rank]
        points = np.array_split(x.reshape(-1, 2), WORLD.size)[WORLD.rank]
        domain = ufl.Mesh(basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,)))
        msh = create_mesh(cells[mine], points, domain)
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        F = ufl.inner(qs.materials.neo_hookean(self.u, 400.0, 600.0), ufl.grad(v)) * ufl.dx
        outside = mesh.locate_entities_boundary(msh, 1, lambda x: np.hypot(x[0], x[1]) > 0.9)
        self.plates = [
            qs.RigidSurface.plane(WORLD, [0.0, side], [0.0, -side]) for side in (-1.0, 1.0)
        ]
        self.contacts = [
            qs.Contact(
                qs.Surface(V, facets=outside),
                plate,
                friction=qs.Coulomb(0.3),
                constraints=constraints,
            )
            for plate in self.plates
        ]
        self.problem = qs.ContactProblem([F], [self.u], self.contacts, stabilisation=stabilisation)
        self.turn = np.radians(turn)
        self.stepper = qs.TimeStepper(self.problem, 1.0, self._move, **stepping)

    def _move(self, t, dt):
        way = [0.0, -SQUEEZE * dt] if t <= 1 + 1e-9 else [2 * self.turn * dt, 0.0]
        self.plates[1].displacement = way

    def step_to(self, t):
        while self.stepper.t < t - 1e-9:
            self.stepper.step(np.floor(self.stepper.t + 1e-9) + 1)

    @property
    def forces(self):
        """Return the forces of the lower and the upper plate on the ring, along y. Collective."""
        return [contact.force("slave")[1] for contact in self.contacts]
