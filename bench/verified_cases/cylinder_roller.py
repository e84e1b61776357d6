"""A steel roller is pressed on an aluminium block: Hertz contact.

Benchmark 1 of A. Konter, *Advanced Finite Element Contact Benchmarks*, NAFEMS R0094 (2006), as
described in MSC's *MD Demonstration Problems*, chapter 1: radius 50 mm, 35 kN/mm, a block of 200 ×
200 mm, plane strain, E = 210 and 70 GPa, ν = 0.3. The closed form of Hertz is for small strains.
The reference displacements of B, on the block below the roller, are from the Code_Aster test
SSNP154, with large displacements and quadratic elements (`ssnp154b`, μ = 0; `d`, μ = 0.1). The
scatter is the difference from its linear elements (−1.30690 and −1.30112, `a` and `c`). The test
calls these values external, but Code_Aster itself computes the same values; the report was not
available.

Our model: half of the bodies, triangles of degree 2, augmented Lagrangian. Small strains are used
for the values of Hertz: the largest pressure at a node, and the half width of the ellipse that fits
the pressures best. For B we use the St. Venant-Kirchhoff material and finite sliding, with the load
in 5 steps. The load is spread over 16 mm at the top of the roller, whereas the benchmark has a
point force.
"""

import itertools

import numpy as np
from common.bodies import facets_at
from verified_cases.elastic import Body, graded
from verified_cases.row import Row

from dolfinx import mesh

import qsdolfinx as qs

TITLE = "Roller on a block (NAFEMS R0094, 1)"
FAR = 0.03

R, SIZE, LOAD, NU = 50.0, 200.0, 35e3, 0.3
E_ROLLER, E_BLOCK = 210e3, 70e3
E_STAR = 1 / ((1 - NU**2) / E_ROLLER + (1 - NU**2) / E_BLOCK)
HALF_WIDTH = np.sqrt(4 * LOAD * R / (np.pi * E_STAR))
PEAK = 2 * LOAD / (np.pi * HALF_WIDTH)
SOURCE = "Code_Aster SSNP154"
STEPS = 5
#: Where the loaded part of the arc ends.
TOP = (8.0, R + np.sqrt(R**2 - 8.0**2))


def create_roller(comm, size, **options):
    """Create the right half of the roller, in contact at its lower arc, with half of the load."""

    def draw(occ):
        around = (0, 0), (R, R), TOP, (0, 2 * R)
        points, centre = [occ.addPoint(*x, 0) for x in around], occ.addPoint(0, R, 0)
        arcs = [occ.addCircleArc(a, centre, b) for a, b in itertools.pairwise(points)]
        loop = occ.addCurveLoop([*arcs, occ.addLine(points[3], points[0])])
        occ.addPlaneSurface([loop])
        return [(0, 0)]

    msh = graded(comm, draw, size, 1.3 * HALF_WIDTH, 0.12)

    def on_arc(x, low, high):
        on = np.isclose(np.hypot(x[0], x[1] - R), R, atol=1e-6)
        return on & (x[1] > low - 1e-6) & (x[1] < high + 1e-6)

    low = mesh.locate_entities_boundary(msh, 1, lambda x: on_arc(x, 0, R))
    top = mesh.locate_entities_boundary(msh, 1, lambda x: on_arc(x, TOP[1], 2 * R))
    roller = Body(msh, E_ROLLER, NU, low, **options)
    roller.hold(facets_at(msh, 0, 0.0), 0)
    return roller, roller.press(top, roller.force_as_traction(top, LOAD / 2))


def create_block(comm, size, **options):
    """Create the right half of the block."""

    def draw(occ):
        occ.addRectangle(0, -SIZE, 0, SIZE / 2, SIZE)
        return [(0, 0)]

    msh = graded(comm, draw, size, 1.3 * HALF_WIDTH, 0.12)
    block = Body(msh, E_BLOCK, NU, facets_at(msh, 1, 0.0), **options)
    block.hold(facets_at(msh, 0, 0.0), 0)
    block.hold(facets_at(msh, 1, -SIZE), 0, 1)
    return block


def press(comm, size, mu=0.0, small=False):
    """Press the roller; returns block and contact."""
    roller, factor = create_roller(comm, size, small=small)
    block = create_block(comm, 1.3 * size, small=small)
    contact = qs.Contact(
        block.surface,
        roller.surface,
        sliding="small" if small else "finite",
        friction=qs.Coulomb(mu) if mu else None,
    )
    problem = qs.ContactProblem(
        [block.F, roller.F], [block.u, roller.u], [contact], [block.bcs, roller.bcs]
    )
    steps = 1 if small else STEPS
    for step in range(steps):
        factor.value = (step + 1) / steps
        problem.solve()
    problem.destroy()
    return block, contact


def pressures(contact):
    """Return the distances from the middle and the pressures at nodes in contact. Collective."""
    p = contact.pressure("slave")
    V = p.function_space
    num_owned = V.dofmap.index_map.size_local
    x, values = V.tabulate_dof_coordinates()[:num_owned], p.x.array[:num_owned]
    found = np.stack([x[values > 0, 0], values[values > 0]])
    return np.concatenate(V.mesh.comm.allgather(found), axis=1)


def half_width(x, p):
    """Fit the half width of the pressure ellipse: p² is linear in x². Skip points near the edge."""
    inside = p > p.max() / 3
    slope, at_middle = np.polyfit(x[inside] ** 2, p[inside] ** 2, 1)
    return np.sqrt(-at_middle / slope)


def run(small, comm):
    """Solve with small strains, and with large strains without and with friction."""
    size = 1.0 if small else 0.15
    x, p = pressures(press(comm, size, small=True)[1])
    rows = [
        Row("half width, mm", HALF_WIDTH, half_width(x, p), 0.0, "closed form"),
        Row("largest pressure, MPa", PEAK, p.max(), 0.0, "closed form"),
    ]
    for mu, reference, linear in ((0.0, -1.30813, -1.30690), (0.1, -1.30269, -1.30112)):
        u_y = press(comm, size, mu)[0].displacement_at(0.0, 0.0)[1]
        scatter = abs(linear / reference - 1)
        rows.append(Row(f"u_y(B), mm, μ = {mu:g}", reference, u_y, scatter, SOURCE))
    return rows
