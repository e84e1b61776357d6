"""Receding contact: an elastic layer is pressed on a half plane and loses contact beside the load.

L. M. Keer, J. Dundurs, K. C. Tsai (J. Appl. Mech. 39, 1972): a pressure q on |x| < h/2 loads a
layer of thickness h. Without friction and weight the layer touches the half plane on |x| < b, for
any load. b depends on the ratio of the moduli E' = E/(1 − ν²). The reference is the integral
equation of this problem, solved here with Chebyshev polynomials (`exact`; b to 3e-8, pressures to
2e-4); a table of the paper was not available. Our model: half of the problem, quadrilaterals of
degree 2 and size 0.05 h (small run: 0.1 h), a layer of length 8 h, a half plane of 40 h × 40 h, and
constraints at points; b is computed from the active points.
"""

import numpy as np
from common.bodies import facets_at, fix, measure
from scipy.optimize import brentq
from scipy.special import jv
from verified_cases.half_space import peak, pressures
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Receding contact of a layer (Keer, Dundurs & Tsai)"
FAR = 0.02

E, NU = 1000.0, 0.3
#: Half the width of the strip, and pressure on it; the layer is 1 thick.
STRIP, LOAD = 0.5, 0.01


def exact(stiffness, terms=10):
    """Return the half width of the contact and the pressure in its middle over q, for h = 1.

    Pressures p cos kx on the lower face of the layer and q cos kx on the upper face displace the
    lower face by cos kx (M p − N q)/k, and the half plane by cos kx p/k, both over 2/E'. Slopes
    are equal for |x| < b.

    Args:
        stiffness: Modulus of the half plane over the modulus of the layer.
        terms: Number of terms of p = √(1 − s²) Σ c_j U_2j(s), s = x/b.
    """
    k, w = (0.5 * (a + shift) for a, shift in zip(np.polynomial.legendre.leggauss(500), (1, 0)))
    k, w = 60 * k, 60 * w
    sinh, cosh = np.sinh(k), np.cosh(k)
    M = (sinh * cosh + k) / (sinh**2 - k**2)
    less = (cosh - 1) / (sinh + k)  # M - N
    q = np.sin(k * STRIP) / (k * STRIP)  # of a load of 1
    j = np.arange(terms)[:, None]
    s = np.cos(np.pi * (2 * np.arange(terms) + 1) / (4 * terms + 2))

    def solve(b):
        """Return the coefficients and the residual of the slope at the point nearest to b."""
        p = np.pi * b * (-1.0) ** j * (2 * j + 1) * jv(2 * j + 1, k * b) / (k * b)
        transform = np.sin(np.outer(s, k * b)) * w
        of_half_planes = np.pi * (1 + 1 / stiffness) * np.cos(np.arccos(s)[:, None] * (2 * j.T + 1))
        A = of_half_planes + transform @ ((M - 1) * p).T
        first = 2 / (np.pi * b)  # balances the load
        known = first * of_half_planes[:, 0]
        known += transform @ (M * (first * p[0] - q) - first * p[0] + less * q)
        c = np.linalg.solve(A[1:, 1:], -known[1:])
        return np.concatenate([[first], c]), A[0, 1:] @ c + known[0]

    at = np.arange(0.5, 4.0, 0.1)
    left = [solve(b)[1] for b in at]
    i = next(i for i in range(len(at)) if left[i] * left[i + 1] < 0)
    b = brentq(lambda b: solve(b)[1], at[i], at[i + 1], xtol=1e-10)
    return b, float(solve(b)[0] @ (-1.0) ** j[:, 0]) * 2 * STRIP


def ticks(even, size, length, growth=0.15):
    """Return vertex coordinates from 0 to a length: even steps up to `even`, then growing ones."""
    steps = size * (1 + growth) ** np.arange(1, 200)
    grown = np.cumsum(steps)
    grown = grown[: np.searchsorted(grown, length - even) + 1] / (length - even)
    first = np.linspace(0, even, round(even / size) + 1)
    return np.concatenate([first, even + (length - even) * grown / grown[-1]])


class Body:
    """Half of the layer or of the half plane, in plane strain, with a vertex at each tick."""

    def __init__(self, comm, modulus, across, up):
        n = len(across) - 1, len(up) - 1
        msh = mesh.create_rectangle(comm, [[0.0, 0.0], [1.0, 1.0]], n, mesh.CellType.quadrilateral)
        x = msh.geometry.x
        for axis, ticks in enumerate((across, up)):
            x[:, axis] = ticks[np.rint(x[:, axis] * n[axis]).astype(int)]
        self.mesh = msh
        self.V = V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
        self.u, self.v = fem.Function(V), ufl.TestFunction(V)
        moduli = (fem.Constant(msh, value) for value in (modulus, NU))
        stress = qs.materials.linear_elastic(self.u, *moduli)
        self.F = ufl.inner(stress, ufl.grad(self.v)) * ufl.dx
        self.bcs = [fix(V, 0, facets_at(msh, 0, 0.0))]
        self.surface = qs.Surface(V, facets=facets_at(msh, 1, 0.0))


def solve(comm, stiffness, size, load):
    """Return the half width of the contact and the pressure in its middle over q."""
    up = np.linspace(0, 1, round(0.5 / size) + 1)
    layer = Body(comm, E, ticks(2.5, size, 8.0), up)
    across, deep = (ticks(even, 1.3 * size, 40.0) for even in (2.5, 1.0))
    plane = Body(comm, stiffness * E, across, -deep[::-1])
    plane.bcs += [fix(plane.V, axis, facets_at(plane.mesh, 1, -40.0)) for axis in range(2)]
    strip = mesh.locate_entities_boundary(
        layer.mesh, 1, lambda x: np.isclose(x[1], 1) & (x[0] < STRIP + 1e-9)
    )
    q = fem.Constant(layer.mesh, load)
    layer.F += q * layer.v[1] * measure(layer.mesh, strip)
    contact = qs.Contact(layer.surface, plane.surface, constraints="points")
    problem = qs.ContactProblem(
        [layer.F, plane.F], [layer.u, plane.u], [contact], [layer.bcs, plane.bcs]
    )
    problem.solve()
    p = pressures(plane.surface, contact, "master")
    return contact.patch()[0], peak(plane.surface, p) / load


def run(small, comm):
    """Rows of the case."""
    size, rows = STRIP / (5 if small else 10), []  # a vertex at the end of the strip
    source = "integral equation"
    for stiffness, name in ((1 / 3, "E'/3"), (1, "E'"), (3, "3 E'")):
        b, p = exact(stiffness)
        found = solve(comm, stiffness, size, LOAD)
        rows.append(Row(f"half plane of {name}: b/h", b, found[0], 0.0, source))
        rows.append(Row(f"half plane of {name}: largest p/q", p, found[1], 0.0, source))
    b = exact(1)[0]
    found = solve(comm, 1, size, 100 * LOAD)[0]
    return [*rows, Row("half plane of E', 100 times the load: b/h", b, found, 0.0, source)]
