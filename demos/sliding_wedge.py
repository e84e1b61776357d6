"""Sliding wedge, after the NAFEMS contact benchmark CGS-4, against the closed form.

A deformable wedge lies on a deformable incline of slope tan α = 0.1; their meshes do not match. The
wedge carries the vertical load G and is pushed up the incline by the horizontal force F. At full
slip equilibrium gives F / G = (tan α + μ) / (1 − μ tan α), for any elastic moduli. For μ = 0 the
contact has no friction law.

The back of the wedge is pushed in steps until all nodes in contact slip, and for two more steps. By
default contact pairs and normals do not change (small sliding). With --travel the steps are
made by qs.TimeStepper, which updates the contact pairs, until the wedge has moved that far.

    python3 demos/sliding_wedge.py --mu 0.3 --plot wedge.png
    mpirun -n 2 python3 demos/sliding_wedge.py --mu 0.1 --formulation double-pass --json wedge.json
    python3 demos/sliding_wedge.py --mu 0.2 --travel 1

Key of the JSON object:

- ratio_error: relative deviation of F / G from the closed form, absolute value.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.command import Command, option, save
from elastic_bodies import create_strip

SLOPE, LOAD, E, NU = 0.1, 1.0, 1e3, 0.3
MAX_STEPS = 30  # largest number of steps to full slip


@dataclasses.dataclass
class Parameters:
    """One wedge; lengths, forces and stresses in any consistent units."""

    mu: float = option(0.2, "coefficient of friction")
    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str | None = option(None)
    n: int = option(1, "factor for the numbers of cells along the edges")
    push: float = option(1e-3, "displacement of the back per step")
    travel: float = option(0.0, "distance to move, with contact pairs updated in each step")


def closed_form(mu):
    """F / G at full slip."""
    return (SLOPE + mu) / (1 - mu * SLOPE)


def build(comm, p):
    """Build the two bodies, their contact and the problem."""
    floor, slope, top = lambda x: -1 + 0 * x, lambda x: SLOPE * x, lambda x: 1.3 + 0 * x
    wedge = create_strip(comm, (13 * p.n, 6 * p.n), (1.2, 4.1), slope, top, E, NU)
    incline = create_strip(comm, (26 * p.n, 5 * p.n), (0.0, 6.0), floor, slope, E, NU)
    wedge.press(LOAD)
    # The back is free to move up: the incline carries all of G. F is the reaction of the guide.
    wedge.guide(wedge.back)
    incline.hold()
    contact = qs.Contact(
        qs.Surface(wedge.V, facets=wedge.lower),
        qs.Surface(incline.V, facets=incline.upper),
        formulation=p.formulation,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        friction=qs.Coulomb(p.mu) if p.mu != 0 else None,
    )
    problem = qs.ContactProblem(
        [wedge.F, incline.F], [wedge.u, incline.u], [contact], [wedge.bcs, incline.bcs]
    )
    return (wedge, incline), contact, problem


def steps(p, wedge, problem):
    """Push the wedge; yield the number of Newton iterations of each step."""
    if p.travel > 0:
        size = p.travel / np.ceil(p.travel / 0.1)  # less than half a facet

        def drive(t, dt):
            wedge.shift.value = t

        stepper = qs.TimeStepper(problem, size, drive, dt_max=size)
        for _ in stepper.run(p.travel):
            yield stepper.num_iterations
    else:
        for _ in range(MAX_STEPS):
            wedge.shift.value += p.push
            problem.solve()
            yield problem.num_iterations


def run(p, comm=MPI.COMM_WORLD):
    """Push; return the results for --json, the rows of the table, and the bodies."""
    bodies, contact, problem = build(comm, p)
    wedge, rows = bodies[0], []
    for iterations in steps(p, wedge, problem):
        force, report = contact.force("slave"), contact.report()
        slipping = report.active if contact.friction is None else report.slipping
        row = {"shift": float(wedge.shift.value), "ratio": wedge.reaction()[0] / LOAD}
        row |= {"contact_ratio": -force[0] / force[1], "carried": force[1] / LOAD}
        row |= {"active": report.active, "slipping": slipping, "iterations": iterations}
        rows.append(row)
        if p.travel <= 0 and [r["slipping"] == r["active"] for r in rows[-3:]] == [True] * 3:
            break
    problem.destroy()
    return {"ratio_error": abs(rows[-1]["ratio"] / closed_form(p.mu) - 1)}, rows, bodies


def main():
    command = Command(__doc__, Parameters, plot="draw stresses and F / G")
    p, a = command.parse()
    if not 0 <= p.mu < 10:
        command.error("--mu: from 0 to below 10, where the wedge would jam")
    result, rows, bodies = run(p)
    tables.sliding_wedge(rows, closed_form(p.mu), **result)
    save(result, a.json)
    if a.plot:
        pictures.sliding_wedge(a.plot, bodies, rows, closed_form(p.mu))
    if rows[-1]["slipping"] != rows[-1]["active"]:
        raise SystemExit("not all nodes slip yet: the closed form does not hold; increase --push")


if __name__ == "__main__":
    main()
