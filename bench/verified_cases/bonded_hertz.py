"""Hertz contact of elastic bodies on curved facets, and contact without slip.

Frictionless contact: a paraboloid of radius R on a half space, a = √(R d), F = 4/3 E* a d, p₀ = 3
F/(2π a²), R = 1000 a, ν = 0.3. Bonded flat punch: F/(2 E* a d) = C = (1 − ν) ln(3 − 4ν)/(1 − 2ν)
(Mossakovskii 1954). Rigid sphere that sticks wherever it has touched: F/(4/3 E* a d) = C and d =
a²/(2 R I), I = ∫₀¹ t cos(β ln((1+t)/(1−t))) dt, 2πβ = ln(3 − 4ν) (Mossakovskii 1963, Spence 1968;
in this form Borodich & Keer 2004). Our model: axisymmetric triangles of degree 2, curved in the
Hertz case, with constraints at points. The bodies are cut off at 20 a, where they are displaced as
by a point force; with twice this radius the force of the bonded punch changes by 2e-5. The sphere
is pressed down in 30 (8) steps. The radius of the active area is known to half a facet, 0.03 (small
run: 0.12) a.
"""

import numpy as np
from scipy.integrate import quad
from verified_cases.half_space import (
    axisymmetric,
    graded,
    moment_radius,
    peak,
    pressures,
    settle,
)
from verified_cases.row import Row

import qsdolfinx as qs

TITLE = "Hertz contact with curved facets, and contact without slip"
FAR = 0.05

R, CUT, DEPTH = 1000.0, 20.0, 1e-3  # a = 1 without friction
CLOSED = "closed form"


def hertz(comm, h):
    """Solve Hertz contact of two elastic bodies without friction; return the rows."""
    E, nu = (3000.0, 1000.0), 0.3
    e_star = 1 / sum((1 - nu**2) / modulus for modulus in E)
    lower = axisymmetric(comm, -1, E[0], nu, CUT, graded(1.3, h))
    upper = axisymmetric(
        comm, 1, E[1], nu, CUT, graded(1.3, 1.3 * h), profile=lambda x: x[0] ** 2 / (2 * R)
    )
    contact = qs.Contact(upper.surface, lower.surface, constraints="points")
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.u, lower.u], [contact], [upper.bcs, lower.bcs]
    )

    def hold(force):
        upper.hold(force, DEPTH)
        lower.hold(force)

    force, exact = settle(problem, contact, hold), 4 / 3 * e_star * DEPTH
    p = pressures(lower.surface, contact, "master")
    return [
        Row("Hertz: force", exact, force, 0.0, CLOSED),
        Row("Hertz: radius, closed area", 1.0, contact.patch()[1], 0.0, CLOSED),
        Row("Hertz: radius, moment", 1.0, moment_radius(lower.surface, p), 0.0, CLOSED),
        Row("Hertz: p₀", 1.5 * exact / np.pi, peak(lower.surface, p), 0.0, CLOSED),
    ]


def bonded_punch(comm, nu, size):
    """Solve for a rigid flat punch of radius 1 that is bonded to the half space."""
    body = axisymmetric(comm, -1, 1000.0, nu, CUT, size, marks=(1.0,), within=1.0)
    punch = qs.RigidSurface.plane(comm, [0.0, 0.0], [0.0, -1.0])
    punch.displacement = [0.0, -DEPTH]
    contact = qs.Contact(body.surface, punch, law=qs.Tied())
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    factor = (1 - nu) * np.log(3 - 4 * nu) / (1 - 2 * nu)
    found = settle(problem, contact, body.hold) / (2 * 1000.0 / (1 - nu**2) * DEPTH)
    return Row(f"bonded punch, ν = {nu}: F/(2 E* a d)", factor, found, 0.0, CLOSED)


def sticking_sphere(comm, nu, h, steps):
    """Solve for a rigid sphere that sticks; the steps increase its contact radius evenly."""
    body = axisymmetric(comm, -1, 1000.0, nu, CUT, graded(1.3, h))
    sphere = qs.RigidSurface.sphere(comm, [0.0, R], R)
    contact = qs.Contact(body.surface, sphere, friction=qs.Sticking())
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    force = 0.0
    for step in range(1, steps + 1):
        sphere.displacement = [0.0, -DEPTH * (step / steps) ** 2]
        # Forces of this problem grow with the third power of the radius.
        body.hold(force * (step / max(step - 1, 1)) ** 3)
        problem.solve()
        force = abs(contact.force("slave")[1])
    beta = np.log(3 - 4 * nu) / (2 * np.pi)
    integral = quad(lambda y: np.cos(2 * beta * y) * np.tanh(y) / np.cosh(y) ** 2, 0, 30)[0]
    a = np.sqrt(2 * integral * R * DEPTH)
    factor = (1 - nu) * np.log(3 - 4 * nu) / (1 - 2 * nu)
    exact = factor * 4 / 3 * 1000.0 / (1 - nu**2) * a * DEPTH
    name = f"sphere that sticks, ν = {nu}: "
    return [
        Row(name + "force", exact, force, 0.0, CLOSED),
        Row(name + "radius, closed area", a, contact.patch()[1], 0.0, CLOSED),
    ]


def run(small, comm):
    """Rows of the case."""
    h, finest = (0.12, 0.02) if small else (0.03, 1e-4)
    edge = graded(1.2, h, growth=0.2 if small else 0.1, edge=1.0, finest=finest)
    return [
        *hertz(comm, h),
        bonded_punch(comm, 0.0, edge),
        bonded_punch(comm, 0.3, edge),
        *sticking_sphere(comm, 0.0, h, 8 if small else 30),
    ]
