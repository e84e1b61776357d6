"""A steel punch with a rounded edge is pressed on an aluminium foundation.

Benchmark 2 of A. Konter, *Advanced Finite Element Contact Benchmarks*, NAFEMS R0094 (2006): punch
Ø100 × 100 mm, edge rounded by 10 mm, foundation Ø200 × 200 mm, fixed at its bottom, 100 MPa;
axisymmetric, E = 210 and 70 GPa, ν = 0.3. These data are from SimScale, solids4foam and Code_Aster
(test SSNA122); the report was not available. M is the middle of the upper face of the foundation.
The references are values of Code_Aster, with large displacements and quadratic elements
(`ssna122b`); their scatter is the difference from linear elements (−0.13073 and −0.12858,
`ssna122a`). The test calls these values external, from Abaqus and Marc, but Code_Aster itself
computes the same values.

Our model: triangles of degree 2, fine where the fillet begins, St. Venant-Kirchhoff material,
augmented Lagrangian, finite sliding, the pressure in 5 steps.
"""

import numpy as np
from common.bodies import facets_at
from verified_cases.elastic import Body, graded
from verified_cases.row import Row

from dolfinx import mesh

import qsdolfinx as qs

TITLE = "Punch with a rounded edge (NAFEMS R0094, 2)"
FAR = 0.015

R, HEIGHT, FILLET, SIZE, PRESSURE, NU = 50.0, 100.0, 10.0, (100.0, 200.0), 100.0, 0.3
E_PUNCH, E_FOUNDATION = 210e3, 70e3
SOURCE = "Code_Aster SSNA122"
STEPS = 5
FINE = {"reach": 2.0, "slope": 0.15}


def create_punch(comm, size):
    """Create the punch; its contact surface is the flat and the fillet."""

    def draw(occ):
        flat = R - FILLET
        around = (0, HEIGHT), (0, 0), (flat, 0), (R, FILLET), (R, HEIGHT)
        p = [occ.addPoint(*x, 0) for x in around]
        lines = [occ.addLine(p[i], p[i + 1]) for i in (0, 1)]
        lines.append(occ.addCircleArc(p[2], occ.addPoint(flat, FILLET, 0), p[3]))
        lines += [occ.addLine(p[3], p[4]), occ.addLine(p[4], p[0])]
        occ.addPlaneSurface([occ.addCurveLoop(lines)])
        return [around[2]]

    def below(x):
        on_fillet = np.isclose(np.hypot(x[0] - R + FILLET, x[1] - FILLET), FILLET, atol=1e-6)
        return np.isclose(x[1], 0) | (on_fillet & (x[1] < FILLET + 1e-6))

    msh = graded(comm, draw, size, **FINE)
    low = mesh.locate_entities_boundary(msh, 1, below)
    punch = Body(msh, E_PUNCH, NU, low, axisymmetric=True)
    punch.hold(facets_at(msh, 0, 0.0), 0)
    return punch, punch.press(facets_at(msh, 1, HEIGHT), PRESSURE)


def create_foundation(comm, size):
    """Create the foundation; its contact surface is the whole upper face."""

    def draw(occ):
        occ.addRectangle(0, -SIZE[1], 0, *SIZE)
        return [(R - FILLET, 0)]

    msh = graded(comm, draw, size, **FINE)
    foundation = Body(msh, E_FOUNDATION, NU, facets_at(msh, 1, 0.0), axisymmetric=True)
    foundation.hold(facets_at(msh, 0, 0.0), 0)
    foundation.hold(facets_at(msh, 1, -SIZE[1]), 0, 1)
    return foundation


def press(comm, size, mu):
    """Press the punch; return the displacement of M along z."""
    punch, factor = create_punch(comm, size)
    foundation = create_foundation(comm, 1.3 * size)
    contact = qs.Contact(
        foundation.surface,
        punch.surface,
        sliding="finite",
        friction=qs.Coulomb(mu) if mu else None,
    )
    bodies = foundation, punch
    problem = qs.ContactProblem(
        [body.F for body in bodies],
        [body.u for body in bodies],
        [contact],
        [body.bcs for body in bodies],
    )
    for step in range(STEPS):
        factor.value = (step + 1) / STEPS
        problem.solve()
    problem.destroy()
    return foundation.displacement_at(0.0, 0.0)[1]


def run(small, comm):
    """Press without and with friction."""
    size, rows = 0.5 if small else 0.1, []
    for mu, reference, linear in ((0.0, -0.132941, -0.130734), (0.1, -0.130794, -0.128580)):
        scatter = abs(linear / reference - 1)
        name = f"u_z(M), mm, μ = {mu:g}"
        rows.append(Row(name, reference, press(comm, size, mu), scatter, SOURCE))
    return rows
