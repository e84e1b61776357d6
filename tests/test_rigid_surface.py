"""Rigid tools: shapes, pairing, motion, driving forces, and bodies pressed against them."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, gathered, largest, plane, slide, raises_everywhere

from dolfinx import fem, mesh

import qsdolfinx as qs

QUADRATURES = ("nodal", "overlay")
E, NU = 7.0, 0.3


class Pressed:
    """A block with sliding sides and bottom, and a tool of some kind at z = 1 that comes down."""

    def __init__(self, cell, tool, n=3, degree=1, comm=WORLD, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.axis = gdim - 1
        self.mesh = box(comm, [n] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
        self.V = fem.functionspace(self.mesh, ("Lagrange", degree, (gdim,)))
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E, NU)
        self.bcs = [slide(self.V, i, plane(self.mesh, i, 0.0)) for i in range(gdim)]
        self.surface = qs.Surface(self.V, facets=plane(self.mesh, self.axis, 1.0))
        self.tool = tool(comm, gdim) if callable(tool) else tool
        options = {"penalty": 1e3, "formulation": "master-slave"} | options
        self.contact = qs.Contact(self.surface, self.tool, **options)
        self.problem = qs.ContactProblem([self.F], [self.u], [self.contact], [self.bcs])

    @property
    def modulus(self):
        """Stress over strain, uniaxial; plane strain in 2D."""
        return E / (1 - NU**2) if self.gdim == 2 else E


def flat(comm, gdim):
    point, normal = np.full(gdim, 0.5), np.zeros(gdim)
    point[-1], normal[-1] = 1.0, -2.0
    return qs.RigidSurface.plane(comm, point, normal)


def flat_facets(comm, gdim):
    """The same plane in triangles or segments, beyond the block on all sides."""
    n, rng = 4, np.random.default_rng(5)
    s = np.linspace(-1.0, 2.0, n + 1)
    if gdim == 2:
        x = np.stack([s, np.ones(n + 1)], axis=1)
        x[1:-1, 0] += 0.2 * rng.uniform(-1, 1, n - 1)
        cells = np.stack([np.arange(n), np.arange(n) + 1], axis=1)
    else:
        x = np.stack([*map(np.ravel, np.meshgrid(s, s)), np.ones((n + 1) ** 2)], axis=1)
        inner = np.all((x[:, :2] > -1) & (x[:, :2] < 2), axis=1)
        x[inner, :2] += 0.2 * rng.uniform(-1, 1, (inner.sum(), 2))
        i = np.arange(n)
        a = ((n + 1) * i[:, None] + i).ravel()
        lower = np.stack([a, a + n + 1, a + 1], axis=1)
        upper = np.stack([a + 1, a + n + 1, a + n + 2], axis=1)
        cells = np.concatenate([lower, upper])
    given = (x, cells) if comm.rank == 0 else (None, None)
    return qs.RigidSurface.triangulated(comm, *given)


TOOLS = {"analytic": flat, "facets": flat_facets}


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", CELLS)
def test_uniform_pressure(cell, tool, quadrature, enforcement):
    """Closed form: stress E ε, with a penalty the compliance 1/ε in series."""
    scene = Pressed(cell, TOOLS[tool], quadrature=quadrature, enforcement=enforcement)
    scene.tool.displacement[-1] = -0.01
    scene.problem.solve()
    compliance = 1 / scene.modulus + (1e-3 if enforcement == "penalty" else 0.0)
    pressure = 0.01 / compliance
    traction = scene.contact.traction("slave").x.array.reshape(-1, scene.gdim)
    top = np.abs(scene.mesh.geometry.x[:, scene.axis] - 1) < 1e-12
    print(scene.contact.force("master"), pressure, traction[traction[:, -1] != 0][:4])
