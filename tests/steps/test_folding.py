"""A tube that is upset until its folds touch each other."""

import numpy as np
import pytest
from scenes import WORLD, clamp, plane, slide

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

RADIUS, THICKNESS, HEIGHT, WAVE = 1.0, 0.12, 2.0, 0.04
#: Number of folds, and in 3D the angle of the sector between planes of symmetry.
FOLDS, SECTOR = 2.5, np.pi / 2


class Tube:
    """A viscous, wavy tube between two ends; the upper end moves down with the velocity 1."""

    def __init__(self, gdim=2, n=3, friction=None):
        self.rings = gdim == 2
        along = round(n * HEIGHT / THICKNESS / 1.5)
        if self.rings:
            corners, counts = [[0.0, 0.0], [THICKNESS, HEIGHT]], [n, along]
            msh = mesh.create_rectangle(WORLD, corners, counts, mesh.CellType.quadrilateral)
        else:
            corners, counts = [[0.0] * 3, [THICKNESS, HEIGHT, SECTOR]], [n, along, 10]
            msh = mesh.create_box(WORLD, corners, counts, mesh.CellType.hexahedron)
        x = msh.geometry.x
        r = RADIUS + x[:, 0] + WAVE * np.sin(2 * np.pi * FOLDS * x[:, 1] / HEIGHT)
        angle = x[:, 2].copy()
        x[:, 0], x[:, 2] = r * np.cos(angle), r * np.sin(angle)
        self.mesh, V = msh, fem.functionspace(msh, ("Lagrange", 1, (gdim,)))
        self.v, w = fem.Function(V), ufl.TestFunction(V)
        rate = self.strain(self.v)
        stress = 2 * rate + 5 * ufl.tr(rate) * ufl.Identity(3)
        weight = qs.materials.axisymmetric_weight(msh) if self.rings else 1.0
        form = ufl.inner(stress, self.strain(w)) * weight * ufl.dx(degree=3)
        fdim = gdim - 1
        every = mesh.locate_entities_boundary(msh, fdim, lambda x: np.full(x.shape[1], True))
        surface = qs.Surface(V, facets=every, axisymmetric=self.rings)
        ends = plane(msh, 1, 0.0), plane(msh, 1, HEIGHT)
        down = [0.0, -1.0] + [0.0] * (gdim - 2)
        bcs = [clamp(V, ends[0]), clamp(V, ends[1], down)]
        if not self.rings:
            bcs += [slide(V, 2, plane(msh, 2, 0.0)), slide(V, 0, plane(msh, 0, 0.0))]
        dt = 0.02 if self.rings else 0.05
        self.contact = qs.Contact(
            surface, surface, unknown="velocity", dt=dt, constraints="points", friction=friction
        )
        problem = qs.ContactProblem([form], [self.v], [self.contact], [bcs])
        self.stepper = qs.TimeStepper(problem, dt)

    def strain(self, u):
        return qs.materials.strain(u, True) if self.rings else ufl.sym(ufl.grad(u))

    def upset(self, by):
        """Largest penetration in a step over its smallest facet, and active nodes at the end."""
        deepest = 0.0
        for _ in self.stepper.run(by):
            size = self.contact.slave.facet_size_range[0]
            deepest = max(deepest, self.contact.penetration() / size)
        return deepest, WORLD.allreduce(int(np.count_nonzero(self.contact.active())))


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)), ids=("smooth", "rough"))
def test_rings(friction):
    """Three axisymmetric folds lie on each other, and surfaces do not penetrate."""
    depth, closed = Tube(friction=friction).upset(1.2)
    assert depth < 0.1
    assert closed >= 3


@pytest.mark.long
def test_in_space():
    depth, closed = Tube(3, 2).upset(1.1)
    assert depth < 0.1
    assert closed >= 3
