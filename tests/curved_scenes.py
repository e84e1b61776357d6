"""Bodies between concentric circles or spheres, whose facets are chords."""

import numpy as np
from scenes import WORLD, box, elastic, elevated

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


class Shell:
    """A part of a ring in 2D or 3D, or of a spherical shell, between two radii.

    Cells are uniform over the angle (and along the axis, or the second angle) and over the radius.
    Geometry and displacements have the given degrees; with "elevated" the geometry is made by
    qs.elevate, with "named" onto the given circles, cylinders or spheres.
    """

    def __init__(
        self,
        n,
        radii,
        cell="quadrilateral",
        sphere=False,
        uneven=0.0,
        partition=None,
        degrees=(1, 1),
    ):
        self.gdim = len(n)
        low, high = [0.0] * self.gdim, [1.0] * self.gdim
        msh = box(WORLD, n, cell, low, high, partition)
        self.mesh = msh = elevated(msh) if degrees[0] == 2 else msh
        radial = self.gdim - 1
        self.inner, self.outer = (self.side(radial, value) for value in (0.0, 1.0))
        self.ends = [[self.side(axis, value) for value in (0.0, 1.0)] for axis in range(radial)]
        x = msh.geometry.x
        p = x[:, : self.gdim].copy()
        inside = uneven * np.prod(np.sin(np.pi * p[:, :radial]), axis=1)
        for axis in range(radial):
            p[:, axis] += inside / n[axis] * np.sin(31 * p[:, axis] + 17 * p[:, 0] + axis)
        r = radii[0] + (radii[1] - radii[0]) * p[:, radial]
        if sphere:
            d = np.column_stack([np.tan(1.2 * (p[:, :2] - 0.5)), np.ones(len(p))])
            x[:] = r[:, None] * d / np.linalg.norm(d, axis=1)[:, None]
        else:
            x[:, 0], x[:, 1] = r * np.cos(0.5 * np.pi * p[:, 0]), r * np.sin(0.5 * np.pi * p[:, 0])
            if self.gdim == 3:
                x[:, 2] = 10 * p[:, 1]
        if degrees[0] in ("elevated", "named"):
            for facets, radius in zip((self.inner, self.outer), radii, strict=True):
                shape = self.named(radius, sphere) if degrees[0] == "named" else None
                self.mesh = msh = qs.elevate(msh, facets=facets, shape=shape)
        self.V = V = fem.functionspace(msh, ("Lagrange", degrees[1], (self.gdim,)))
        self.u = fem.Function(V)
        self.F = elastic(self.u, E=200e3)

    def named(self, radius, sphere):
        """The surface on which one side is."""
        if sphere:
            return qs.smooth.Sphere([0.0] * self.gdim, radius)
        axis = None if self.gdim == 2 else [0.0, 0.0, 1.0]
        return qs.smooth.Cylinder([0.0] * self.gdim, axis, radius)

    def load(self, facets, traction):
        """Add a traction, a UFL expression, on facets."""
        tags = mesh.meshtags(self.mesh, self.gdim - 1, np.sort(facets), np.ones_like(facets))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        self.F -= ufl.inner(traction, ufl.TestFunction(self.V)) * ds

    def side(self, axis, value):
        fdim = self.gdim - 1
        return mesh.locate_entities_boundary(
            self.mesh, fdim, lambda x: np.isclose(x[axis], value, atol=1e-9)
        )

    def surface(self, facets):
        return qs.Surface(self.V, facets=facets)

    def symmetry(self):
        """Make symmetry conditions of a quarter of a ring, held along the axis in 3D."""
        planes = [(1, self.ends[0][0]), (0, self.ends[0][1])]
        planes += [(2, end) for ends in self.ends[1:] for end in ends]
        fdim = self.gdim - 1
        return [
            fem.dirichletbc(
                fem.Constant(self.mesh, 0.0),
                fem.locate_dofs_topological(self.V.sub(axis), fdim, facets),
                self.V.sub(axis),
            )
            for axis, facets in planes
        ]


class Rings:
    """Two rings, an inner and an outer one; a quarter is meshed.

    Args:
        n: Numbers of cells of the inner and of the outer ring.
        radii: Inner and outer radius of each ring.
    """

    def __init__(
        self,
        n,
        radii,
        swap=False,
        cell="quadrilateral",
        uneven=0.0,
        degrees=(1, 1),
        **options,
    ):
        self.inner, self.outer = (
            Shell(count, r, cell, uneven=jitter, partition=partition, degrees=degrees)
            for count, r, jitter, partition in zip(
                n, radii, (uneven, -uneven), ("forward", "scattered"), strict=True
            )
        )
        sides = [self.inner.surface(self.inner.outer), self.outer.surface(self.outer.inner)]
        slave, master = sides[::-1] if swap else sides
        options = {"quadrature": "overlay"} | options
        self.contact = qs.Contact(slave, master, **options)

    def problem(self):
        bodies = self.inner, self.outer
        return qs.ContactProblem(
            [b.F for b in bodies],
            [b.u for b in bodies],
            [self.contact],
            [b.symmetry() for b in bodies],
        )

    def pressure(self, side):
        """Return mean and scatter over the area of one side. Collective."""
        surface = getattr(self.contact, side).linear
        t = surface.node_values(self.contact.traction(side))[:, :2]
        x = surface.node_x[:, :2]
        p = np.abs(np.sum(t * x, axis=1)) / np.linalg.norm(x, axis=1)
        w = surface.node_area
        area, first, second = WORLD.allreduce(np.array([w.sum(), w @ p, w @ p**2]))
        mean = first / area
        return mean, np.sqrt(max(second / area - mean**2, 0.0))


class ShrinkFit(Rings):
    """Make a quarter of rings of 5 to R + δ/2 and R − δ/2 to 15, R = 10."""

    R = 10.0

    def __init__(self, n, swap=False, misfit=0.01, **options):
        half = misfit / 2
        super().__init__(n, ((5.0, self.R + half), (self.R - half, 15.0)), swap, **options)


class LoadedRings(Rings):
    """Rings of ½ to 1 to 1½ with the contact pressure p + q cos 2θ, from a load on the outside.

    Michell's solution in plane strain: the inner boundary is free, no side has friction, and radial
    displacements agree at the interface.
    """

    P, Q, E, NU = 50.0, 15.0, 200e3, 0.3

    def __init__(self, n, swap=False, **options):
        super().__init__(n, ((0.5, 1.0), (1.0, 1.5)), swap, **options)
        uniform, second = self.load_without(0.5, 1.5)
        x = ufl.SpatialCoordinate(self.outer.mesh)
        r = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        cosine = (x[0] ** 2 - x[1] ** 2) / r**2
        self.outer.load(self.outer.outer, (uniform + second * cosine) * x / r)

    def load_without(self, a, b):
        """Return the stress σ_rr = s_0 + s_2 cos 2θ at the outer radius."""
        k = 3 - 4 * self.NU

        def even(r):  # from φ = A r² + B ln r: σ_rr, and 2μ u_r
            return np.array([[2, r**-2.0], [(k - 1) * r, -1 / r]])

        def second(r):  # from (A r² + B r⁴ + C r⁻² + D) cos 2θ: σ_rr, σ_rθ, and 2μ u_r
            return np.array(
                [
                    [-2, 0, -6 * r**-4.0, -4 * r**-2.0],
                    [2, 6 * r**2, -6 * r**-4.0, -2 * r**-2.0],
                    [-2 * r, (k - 3) * r**3, 2 * r**-3.0, (k + 1) / r],
                ]
            )

        solve = np.linalg.solve
        inner = solve([even(a)[0], even(1.0)[0]], [0, -self.P])
        outer = solve(even(1.0), [-self.P, even(1.0)[1] @ inner])
        inner_2 = solve([*second(a)[:2], *second(1.0)[:2]], [0, 0, -self.Q, 0])
        fits = [-self.Q, 0, second(1.0)[2] @ inner_2, 0]
        outer_2 = solve([*second(1.0), second(b)[1]], fits)
        return even(b)[0] @ outer, second(b)[0] @ outer_2

    def error(self, side):
        """Return the L2 error of the pressure over its mean. Collective."""
        surface = getattr(self.contact, side).linear
        t = surface.node_values(self.contact.traction(side))[:, :2]
        x = surface.node_x[:, :2]
        r = np.linalg.norm(x, axis=1)
        exact = self.P + self.Q * (x[:, 0] ** 2 - x[:, 1] ** 2) / r**2
        off = np.abs(np.sum(t * x, axis=1)) / r - exact
        w = surface.node_area
        area, square = WORLD.allreduce(np.array([w.sum(), w @ off**2]))
        return np.sqrt(square / area) / self.P


def exact_pressure(misfit=0.01, E=200e3, nu=0.3):
    """Return Lamé's pressure in plane strain for rings 5 to 10 to 15 of one material."""
    a, R, b = 5.0, ShrinkFit.R, 15.0
    E, nu = E / (1 - nu**2), nu / (1 - nu)
    outer = (b**2 + R**2) / (b**2 - R**2) + nu
    inner = (R**2 + a**2) / (R**2 - a**2) - nu
    return misfit * E / R / (outer + inner)
