"""The lower one of two squares is pulled off the upper one, except in its middle.

Side 0.01 m, plane strain, no friction. The lower square, E = 15e9 Pa, ν = 0.2, is fixed at its
bottom; the top of the upper square, 20e9 Pa and 0.4, is moved down by 5e-7 m. Tractions of 1e5 Pa
inwards and 1e6 Pa downwards act on the sides of the lower square. The problem is from S. Hüeber's
thesis (page 44). The references are displacements at the interface in the CalculiX test hueeber1
(hueeber1.inp, hueeber1.dat.ref): face-to-face contact with a penalty of 1e15 Pa/m. Our model: the
same penalty and meshes, 60 × 60 and 70 × 70 cells of degree 1 (CalculiX uses one layer of bricks);
the small run has 12 × 12 and 14 × 14 cells.
"""

import numpy as np
from common.bodies import facets_at, fix, measure
from verified_cases.probes import at_node
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Two squares that lose contact (CalculiX, hueeber1)"
FAR = 0.12

SIDE = 0.01


MOVED = -5e-7
#: Body, quantity, x (m), component, reference (m).
REFERENCES = (
    ("lower", 0.01, 0, 4.934943e-07),
    ("lower", 0.01, 1, -1.205747e-06),
    ("lower", 0.0075, 0, 2.617351e-07),
    ("lower", 0.0075, 1, -5.838205e-07),
    ("lower", 0.005, 1, -4.652853e-07),
    ("upper", 0.005, 1, -4.655396e-07),
    ("upper", 0.01, 1, -4.936701e-07),
)


def square(n, bottom, E, nu, comm):
    """Return the residual, displacement, conditions and contact surface of a square."""
    corners = [[0.0, bottom], [SIDE, bottom + SIDE]]
    msh = mesh.create_rectangle(comm, corners, [n, n], mesh.CellType.quadrilateral)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.linear_elastic(u, E, nu), ufl.grad(v)) * ufl.dx
    far, moved = (0.0, 0.0) if bottom == 0 else (2 * SIDE, MOVED)
    bcs = [fix(V, axis, facets_at(msh, 1, far), value) for axis, value in enumerate((0.0, moved))]
    if bottom == 0:
        n, sides = ufl.FacetNormal(msh), [facets_at(msh, 0, x) for x in (0.0, SIDE)]
        F += (1e5 * n[0] * v[0] + 1e6 * v[1]) * measure(msh, np.hstack(sides))
    return F, u, bcs, qs.Surface(V, facets=facets_at(msh, 1, SIDE))


def run(small, comm):
    """Return displacements at the interface; for the upper body also relative to its top."""
    lower, upper = (12, 14) if small else (60, 70)
    F, u, bcs, (master, slave) = zip(
        square(lower, 0.0, 15e9, 0.2, comm), square(upper, SIDE, 20e9, 0.4, comm), strict=True
    )
    qs.ContactProblem(
        F, u, [qs.Contact(slave, master, enforcement="penalty", penalty=1e15)], bcs
    ).solve()
    bodies, rows = dict(zip(("lower", "upper"), u, strict=True)), []
    for body, x, axis, reference in REFERENCES:
        ours = at_node(bodies[body], (x, SIDE))[axis]
        name = f"u_{'xy'[axis]} of the {body} body at x = {x} m"
        rows.append(Row(name, reference, ours, 0.0, "hueeber1"))
        if body == "upper":
            name = f"{name}, less that of its top"
            rows.append(Row(name, reference - MOVED, ours - MOVED, 0.0, "hueeber1"))
    return rows
