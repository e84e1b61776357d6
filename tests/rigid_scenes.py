"""Rigid tools, and blocks that they press, for the tests."""

import numpy as np
from scenes import WORLD, box, elastic, largest, plane, slide

from dolfinx import fem

import qsdolfinx as qs

E, NU = 7.0, 0.3


class Pressed:
    """A block that may slide on all its sides, with a tool of some kind on its upper face."""

    def __init__(
        self, cell, tool, n=3, degree=1, comm=WORLD, held=True, nu=NU, uneven=0.08, **options
    ):
        self.nu = nu
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.axis = gdim - 1
        self.mesh = box(comm, [n] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
        x = self.mesh.geometry.x  # uneven facets, for which uniform stress is exact as well
        x[:, 0] += uneven * np.sin(np.pi * x[:, 0]) * np.cos(4 * x[:, 1]) * x[:, self.axis]
        self.V = fem.functionspace(self.mesh, ("Lagrange", degree, (gdim,)))
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E, nu)
        fixed = range(gdim) if held else range(gdim - 1)
        self.bcs = [slide(self.V, i, plane(self.mesh, i, 0.0)) for i in fixed]
        self.surface = qs.Surface(self.V, facets=plane(self.mesh, self.axis, 1.0))
        self.tool = tool(comm, gdim)
        options = {"penalty": 1e3, "formulation": "master-slave"} | options
        self.contact = qs.Contact(self.surface, self.tool, **options)
        self.problem = qs.ContactProblem([self.F], [self.u], [self.contact], [self.bcs])

    @property
    def modulus(self):
        """Return the ratio of stress to strain, uniaxial; plane strain in 2D."""
        return E / (1 - self.nu**2) if self.gdim == 2 else E

    @property
    def compliance(self):
        """Return the compliance 1/ε of a penalty, in series with the block."""
        return 0.0 if self.contact.model.augmented else 1 / self.contact.penalty

    def is_uniform(self, depth):
        """Press the tool down, and compare with the closed form."""
        self.tool.displacement[-1] = -depth
        self.problem.solve()
        pressure = depth / (1 / self.modulus + self.compliance)
        surface = self.surface.linear
        traction = self.contact.traction("slave")
        owned = surface.node_dofs - traction.function_space.dofmap.index_map.local_range[0] * (
            self.gdim
        )
        expected = np.zeros(self.gdim)
        expected[-1] = pressure
        u = self.u.x.array.reshape(-1, self.gdim)
        x = self.V.tabulate_dof_coordinates()
        strain = pressure / self.modulus
        np.testing.assert_allclose(
            self.contact.force("master"), expected, atol=abs(1e-8 * pressure)
        )
        assert largest(traction.x.array[owned] + expected) < abs(1e-8 * pressure)
        assert largest(u[:, -1] + strain * x[:, self.axis]) < abs(1e-8 * strain)


def flat(comm, gdim):
    """Make the plane that bounds the half-space above the block."""
    point, normal = np.full(gdim, 0.5), np.zeros(gdim)
    point[-1], normal[-1] = 1.0, -2.0
    return qs.RigidSurface.plane(comm, point, normal)


def flat_facets(comm, gdim):
    """Make the same plane of triangles or segments that extend beyond the block on all sides."""
    n, rng = 4, np.random.default_rng(5)
    s = np.linspace(-1.0, 2.0, n + 1)
    if gdim == 2:
        x = np.stack([s, np.ones(n + 1)], axis=1)
        x[1:-1, 0] += 0.2 * rng.uniform(-1, 1, n - 1)
    else:
        x = np.stack([*map(np.ravel, np.meshgrid(s, s)), np.ones((n + 1) ** 2)], axis=1)
        inner = np.all((x[:, :2] > -1) & (x[:, :2] < 2), axis=1)
        x[inner, :2] += 0.2 * rng.uniform(-1, 1, (inner.sum(), 2))
    given = (x, grid_cells(n, gdim)) if comm.rank == 0 else (None, None)
    return qs.RigidSurface.triangulated(comm, *given, center=[0.5] * (gdim - 1) + [1.0])


def grid_cells(n, gdim):
    """Return facets of a structured grid, outward to -z (2D: to the right of the segments)."""
    i = np.arange(n)
    if gdim == 2:
        return np.stack([i, i + 1], axis=1)
    a = ((n + 1) * i[:, None] + i).ravel()
    lower = np.stack([a, a + n + 1, a + 1], axis=1)
    upper = np.stack([a + 1, a + n + 1, a + n + 2], axis=1)
    return np.concatenate([lower, upper])


def sphere_facets(comm, n, center, radius):
    """Make the lower part of a sphere or circle around the pole, n facets across."""
    gdim = len(center)
    s = np.linspace(-1.0, 1.0, n + 1)
    flat_x = s[:, None] if gdim == 2 else np.stack([*map(np.ravel, np.meshgrid(s, s))], axis=1)
    ray = np.column_stack([flat_x, -np.ones(len(flat_x))])
    x = center + radius * ray / np.linalg.norm(ray, axis=1)[:, None]
    return qs.RigidSurface.triangulated(comm, x, grid_cells(n, gdim), center=center)


def write_stl(filename, corners, binary):
    """Write an STL file of triangles, shape (triangles, 3, 3)."""
    if binary:
        record = np.dtype([("normal", "<f4", 3), ("x", "<f4", (3, 3)), ("attribute", "<u2")])
        data = np.zeros(len(corners), record)
        data["x"] = corners
        with open(filename, "wb") as file:
            file.write(b"tool".ljust(80) + np.uint32(len(corners)).tobytes() + data.tobytes())
        return
    with open(filename, "w") as file:
        file.write("solid tool\n")
        for triangle in corners:
            lines = "".join(f"      vertex {x} {y} {z}\n" for x, y, z in triangle)
            file.write(f"  facet normal 0 0 0\n    outer loop\n{lines}    endloop\n  endfacet\n")
        file.write("endsolid tool\n")


TOOLS = {"analytic": flat, "facets": flat_facets}
