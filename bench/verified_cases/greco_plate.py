"""A square plate slides on a rigid plane, pressed from above and from the side.

Side 0.04 m, E = 1.3e11 Pa, ν = 0.2, plane strain, Coulomb friction with μ = 1. A pressure of 5e7 Pa
acts on the top, and a pressure of 15e7 Pa on the left. The right side is a plane of symmetry, and
its lowest point is fixed. The references are displacements of points of the contact surface, means
of the codes of a French group (GRECO; R. A. Feijóo, H. J. C. Barbosa, N. Zouain), as quoted in
Code_Aster's validation case SSNV128 (V6.04.128), with a tolerance of 5 %. The input of Code_Aster
(ssnv128a) has the geometry. Its 2D models with multipliers (M, P, Q) give 1.536e-5 to 1.541e-5 m at
the last point. Our model: 128 × 64 quadrilaterals of degree 1, five equal steps as in Code_Aster;
the small mesh is the mesh of Code_Aster, 32 × 10.
"""

import numpy as np
from common.bodies import facets_at, fix, measure
from verified_cases.probes import at_node
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Plate on a rigid plane with friction (GRECO, SSNV128)"
FAR = 0.03

SIDE = 0.04
REFERENCES = {
    "A": (0.0, 2.86e-5),
    "B": (0.00125, 2.72e-5),
    "C": (0.005, 2.28e-5),
    "D": (0.0075, 1.98e-5),
    "E": (0.01125, 1.50e-5),
}


def solve(cells, comm):
    """Return the displacement of the plate with the given numbers of cells along x and y."""
    corners = [[0.0, 0.0], [SIDE, SIDE]]
    msh = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, load = fem.Function(V), ufl.TestFunction(V), fem.Constant(msh, 0.0)
    F = ufl.inner(qs.materials.linear_elastic(u, 1.3e11, 0.2), ufl.grad(v)) * ufl.dx
    n, pressed = ufl.FacetNormal(msh), [facets_at(msh, 0, 0.0), facets_at(msh, 1, SIDE)]
    pressure = load * (15e7 * n[0] * v[0] + 5e7 * n[1] * v[1])
    F += pressure * measure(msh, np.hstack(pressed))
    held = fem.locate_dofs_topological(
        V.sub(1),
        0,
        mesh.locate_entities_boundary(
            msh, 0, lambda x: np.isclose(x[0], SIDE) & np.isclose(x[1], 0)
        ),
    )
    bcs = [fix(V, 0, facets_at(msh, 0, SIDE)), fem.dirichletbc(0.0, held, V.sub(1))]
    plane = qs.RigidSurface.plane(comm, [0, 0], [0, 1])
    bottom = qs.Surface(V, facets=facets_at(msh, 1, 0.0))
    contact = qs.Contact(bottom, plane, friction=qs.Coulomb(1.0))
    problem = qs.ContactProblem([F], [u], [contact], [bcs])
    for step in range(1, 6):
        load.value = step / 5
        problem.solve()
    return u


def run(small, comm):
    """Tangential displacements of the five points."""
    u = solve([32, 10] if small else [128, 64], comm)
    return [
        Row(f"u_x at {name}, x = {x} m", reference, at_node(u, (x, 0.0))[0], 0.05, "SSNV128")
        for name, (x, reference) in REFERENCES.items()
    ]
