"""A rigid flat punch of radius a on an elastic half space, frictionless (Boussinesq 1885).

At the depth d the force is F = 2 E* a d, the pressure is F/(2π a √(a² − r²)), and the surface
beside the punch sinks by 2 d/π asin(a/r). E = 1000, ν = 0.3, a = 1, d = 1e-4 (small strains). The
half space is cut off at 20 a, where it is displaced as by a point force; with twice this radius the
force changes by 5e-5. Our model: axisymmetric triangles of degree 2, with the size a/10000 at the
edge of the punch (small run: a/50) and a vertex there. The punch is a flat facet of a rigid tool
that ends at the radius a; the contact surface of the half space extends further.
"""

import numpy as np
from verified_cases.half_space import axisymmetric, graded, pressures, settle, value_at
from verified_cases.row import Row

from dolfinx import fem

import qsdolfinx as qs

TITLE = "Rigid flat punch on a half space (Boussinesq)"
FAR = 0.01

E, NU, DEPTH, CUT = 1000.0, 0.3, 1e-4, 20.0
FORCE = 2 * E / (1 - NU**2) * DEPTH


def settlement(body):
    """Return the downward displacement of the surface at twice the punch radius. Collective."""
    component, dofs = body.V.sub(1).collapse()
    u = fem.Function(component)
    u.x.array[:] = body.u.x.array[dofs]
    there = fem.locate_dofs_geometrical(
        component, lambda x: np.isclose(x[0], 2.0) & np.isclose(x[1], 0.0)
    )
    values = np.concatenate(body.mesh.comm.allgather(u.x.array[there]))
    return -values[0]


def run(small, comm):
    """Rows of the case."""
    size = graded(1.2, 0.1, edge=1.0, finest=0.02) if small else graded(1.2, 0.04, 0.1, 1.0, 1e-4)
    body = axisymmetric(comm, -1, E, NU, CUT, size, marks=(1.0, 2.0))
    x = np.array([[0.0, 0.0], [1.0, 0.0]])
    punch = qs.RigidSurface.triangulated(comm, x, np.array([[0, 1]]))
    punch.displacement = [0.0, -DEPTH]
    contact = qs.Contact(body.surface, punch)
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    force = settle(problem, contact, body.hold)
    p = pressures(body.surface, contact, "slave")
    middle, beside = (value_at(body.surface, p, r) for r in (0.0, 0.5))
    closed = "closed form"
    return [
        Row("force", FORCE, force, 0.0, closed),
        Row("pressure at 0", FORCE / (2 * np.pi), middle, 0.0, closed),
        Row("pressure at a/2", FORCE / (np.pi * np.sqrt(3)), beside, 0.0, closed),
        Row("settlement at 2 a", DEPTH / 3, settlement(body), 0.0, closed),
    ]
