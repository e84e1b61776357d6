"""A rigid cone on an elastic half space, frictionless (I. N. Sneddon, Int. J. Eng. Sci. 3, 1965).

At the depth d a cone whose sides rise by m per length has the force F = 2 E* d²/(π m), the contact
radius a = 2 d/(π m) and the pressure ½ E* m arcosh(a/r), which is unbounded at its tip. E = 1000, ν
= 0.3, m = 0.001 (small strains), a = 1. The half space is cut off at 20 a, where it is displaced as
by a point force; with twice this radius the force changes by 8e-5. Our model: axisymmetric
triangles of degree 2, small at the tip. The cone is a facet of a rigid tool; constraints are at
points, and the radius is computed from the active points.
"""

import numpy as np
from verified_cases.half_space import axisymmetric, graded, pressures, settle, value_at
from verified_cases.row import Row

import qsdolfinx as qs

TITLE = "Rigid cone on a half space (Sneddon)"
FAR = 0.02

E, NU, SLOPE, CUT = 1000.0, 0.3, 1e-3, 20.0
E_STAR = E / (1 - NU**2)
DEPTH = np.pi / 2 * SLOPE  # of a = 1


def run(small, comm):
    """Rows of the case."""
    h = 0.08 if small else 0.02
    size = graded(1.2, h, edge=0.0, finest=h / 4)
    body = axisymmetric(comm, -1, E, NU, CUT, size)
    x = np.array([[0.0, 0.0], [5.0, 5 * SLOPE]])
    cone = qs.RigidSurface.triangulated(comm, x, np.array([[0, 1]]))
    cone.displacement = [0.0, -DEPTH]
    contact = qs.Contact(body.surface, cone, constraints="points")
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    force = settle(problem, contact, body.hold)
    p = value_at(body.surface, pressures(body.surface, contact, "slave"), 0.5)
    exact = E_STAR * SLOPE / 2 * np.arccosh(2)
    closed = "closed form"
    return [
        Row("force", 2 * E_STAR * DEPTH**2 / (np.pi * SLOPE), force, 0.0, closed),
        Row("contact radius", 1.0, contact.patch()[1], 0.0, closed),
        Row("pressure at a/2", exact, p, 0.0, closed),
    ]
