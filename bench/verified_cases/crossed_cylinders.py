"""Two elastic cylinders crossed at right angles, frictionless: Hertz contact in 3D (1882).

Radii R and R: a circle, a = √(R d), F = 4/3 E* a d, p₀ = 3 F/(2π a²). Radii R and R/3: an ellipse,
b = a √(1 − e²), 1/2R = d (K − E)/(K e² a²), 3/2R = d (E/(1 − e²) − K)/(K e² a²), p₀ = d E*/(b K), F
= ⅔ π a b p₀, with the complete elliptic integrals K and E of e (K. L. Johnson, Contact Mechanics,
1985, section 4.2). R = 1000 a; parabolas approximate the cylinders. Our model: a quarter of both
bodies, non-matching hexahedra of degree 1, 9 and 7 along a (small run: 4 and 3). They are too
stiff, and therefore the force is too large. The bodies are cubes of side 8 a, whose outer faces are
displaced as by a point force; the relative error of the force due to this is of the order (a/8a)³,
2e-3. Constraints at points. The half axes are computed from the second moments of the pressure, the
area from the active points.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from verified_cases.half_space import HalfSpace, moment_radius, peak, pressures, settle
from verified_cases.row import Row

from dolfinx import mesh

import qsdolfinx as qs

TITLE = "Crossed cylinders (Hertz)"
FAR = 0.09

R, SIDE = 1000.0, 8.0
E, NU = (3000.0, 1000.0), 0.3
E_STAR = 1 / sum((1 - NU**2) / modulus for modulus in E)
#: Radius, in half axes, up to which cells are even, and the part of all cells within it.
EVEN, SHARE = 1.25, 0.55


def ellipse(ratio):
    """Return approach, half axis b, force and peak pressure for radii R and R / ratio, a = 1."""
    if ratio == 1:
        return 1 / R, 1.0, 4 / 3 * E_STAR / R, 2 * E_STAR / (np.pi * R)

    def curvatures(m):
        """Return the curvatures of the gap along both axes over the approach; m = e²."""
        K, E_ = ellipk(m), ellipe(m)
        return np.array([K - E_, E_ / (1 - m) - K]) / (K * m)

    def difference(m):
        along, across = curvatures(m)
        return across / along - ratio

    m = brentq(difference, 1e-6, 1 - 1e-6)
    d, b = 1 / (2 * R * curvatures(m)[0]), np.sqrt(1 - m)
    p0 = d * E_STAR / (b * ellipk(m))
    return d, b, 2 / 3 * np.pi * b * p0, p0


def stretched(s, even):
    """Map s from 0 to 1 to 0 to SIDE: even steps up to `even`, then growing steps."""
    slope, rest = even / SHARE, 1 - SHARE

    def grown(rate, t):
        return even + slope * np.expm1(rate * t) / rate

    rate = brentq(lambda rate: grown(rate, rest) - SIDE, 1e-6, 50)
    return np.where(s <= SHARE, slope * s, grown(rate, np.maximum(s - SHARE, 0)))


def body(comm, sign, modulus, n, b, radius):
    """Create a quarter of a cylinder, along x for the lower body, along y for the upper body."""
    msh = mesh.create_box(comm, [[0.0] * 3, [1.0] * 3], [n] * 3, cell_type=mesh.CellType.hexahedron)
    x = msh.geometry.x
    for axis, even in enumerate((EVEN, EVEN * b, 0.5 * EVEN * b)):
        x[:, axis] = stretched(x[:, axis], even)
    x[:, 2] *= sign

    def outside(x):
        return np.isclose(x[0], SIDE) | np.isclose(x[1], SIDE) | np.isclose(abs(x[2]), SIDE)

    def profile(x):
        return x[0 if sign > 0 else 1] ** 2 / (2 * radius)

    return HalfSpace(msh, sign, modulus, NU, outside, profile=profile, degree=1)


def solve(comm, sizes, ratio, name):
    """Return the rows for one pair of radii."""
    approach, b, exact, p0 = ellipse(ratio)
    lower = body(comm, -1, E[0], sizes[0], b, R / ratio)
    upper = body(comm, 1, E[1], sizes[1], b, R)
    contact = qs.Contact(upper.surface, lower.surface, constraints="points")
    problem = qs.ContactProblem(
        [upper.F, lower.F],
        [upper.u, lower.u],
        [contact],
        [upper.bcs, lower.bcs],
        linear_solver="amg",
    )

    def hold(force):
        upper.hold(force, approach)
        lower.hold(force)

    force = settle(problem, contact, hold, parts=4)
    p = pressures(lower.surface, contact, "master")
    radii = [moment_radius(lower.surface, p, axis) for axis in range(2)]
    closed = "closed form"
    rows = [Row(f"{name}: force", exact, force, 0.0, closed)]
    rows.append(Row(f"{name}: p₀", p0, peak(lower.surface, p), 0.0, closed))
    for half_axis, found, letter in zip((1.0, b), radii, "ab", strict=True):
        rows.append(Row(f"{name}: {letter}", half_axis, found, 0.0, closed))
    area = np.pi * b
    return [*rows, Row(f"{name}: area", area, 4 * contact.patch()[0], 0.0, closed)]


def run(small, comm):
    """Rows of the case."""
    sizes = (10, 8) if small else (20, 16)
    return solve(comm, sizes, 1, "equal") + solve(comm, sizes, 3, "3 : 1")
