"""Press a block on a larger, coarser block and drag it: stick, partial slip, full slip.

The upper block, 1 × 1 × 0.5 in cells of 1/6, carries a dead load on its top, N in total. The lower
block, 2 × 1.7 × 0.5 in cells of about 1/3, is held at its bottom. The first step applies N; later
steps drag the top along x until all nodes in contact slip. Then the total friction is μ N, but part
of it is not along x: under N the upper block expanded to all sides against friction. It is
therefore dragged further, by larger steps, until T, the force along x, changes by less than
1e-7 μ N in a step. Contact pairs and normals do not change (small sliding).

    python3 demos/block_on_block.py
    mpirun -n 2 python3 demos/block_on_block.py --mu 0.5 --json block.json
    python3 demos/block_on_block.py --n 2 --plot block.png

The demo ends with status 1 if friction dissipates energy at a node that sticks, or if it returns
energy. Keys of the JSON object:

- friction_force_error: |T − μ N| / (μ N) at the end;
- partial_slip_seen: 1 if in some step a part of the nodes in contact slips, 0 otherwise;
- energy_error: friction's dissipation in the last step over the work of T in this step, less 1;
- min_dissipation: smallest dissipation of friction at a node in a step, over that work;
- stick_dissipation: largest dissipation of friction in a step at nodes that stick, over that work;
- force_balance_error: maximum of |F_slave + F_master| / N and |F_z − N| / N over all steps;
- snes_iterations: number of Newton iterations of all steps.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.command import Command, option, report
from common.measures import stick_and_slip
from elastic_bodies import create_box

LOAD, E, NU = 2.0, 100.0, 0.3
#: Largest number of steps to full slip, and after it; size of the latter over that of the former.
MAX_STEPS, MAX_SLIDES, SLIDE = 40, 10, 25


@dataclasses.dataclass
class Parameters:
    """One pair of blocks; lengths, forces and stresses in any consistent units."""

    mu: float = option(0.3, "coefficient of friction, above 0")
    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str | None = option(None)
    n: int = option(1, "factor for the numbers of cells along the edges")
    push: float = option(2e-3, "displacement of the top per step")


def build(comm, p):
    """Build the upper block, the contact and the problem."""
    upper = create_box(comm, (6 * p.n, 6 * p.n, 3 * p.n), [0.5, 0.35, 0.0], [1.5, 1.35, 0.5], E, NU)
    lower = create_box(comm, (6 * p.n, 5 * p.n, 2 * p.n), [0.0, 0.0, -0.5], [2.0, 1.7, 0.0], E, NU)
    upper.press(LOAD)
    upper.guide(upper.upper)
    lower.hold()
    contact = qs.Contact(
        qs.Surface(upper.V, facets=upper.lower),
        qs.Surface(lower.V, facets=lower.upper),
        formulation=p.formulation,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        friction=qs.Coulomb(p.mu),
        sliding="small",
    )
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.u, lower.u], [contact], [upper.bcs, lower.bcs]
    )
    return upper, contact, problem


def state(p, upper, contact):
    """Compute a row of the table. Collective."""
    force = contact.force("slave")
    unbalanced = force + contact.force("master"), [force[2] - LOAD]
    return stick_and_slip(contact) | {
        "shift": float(upper.shift.value),
        "ratio": upper.reaction()[0] / (p.mu * LOAD),
        "energy": contact.dissipated_energy(),
        "step_energy": contact.step_dissipation(),
        "balance": max(np.linalg.norm(f) for f in unbalanced) / LOAD,
    }


def sizes(p, rows):
    """Generate the displacement increment of the top for each step; rows: results so far."""
    yield 0.0  # pressing
    for _ in range(MAX_STEPS):
        if rows[-1]["stick"] == 0:
            break
        yield p.push
    for _ in range(MAX_SLIDES):
        yield SLIDE * p.push
        if abs(rows[-1]["ratio"] - rows[-2]["ratio"]) < 1e-7:
            return


def run(p, comm=MPI.COMM_WORLD, look=None):
    """Press and drag; return the results for --json, and the states after the steps.

    look is called with contact and state after each step.
    """
    upper, contact, problem = build(comm, p)
    rows = []
    for size in sizes(p, rows):
        upper.shift.value += size
        problem.solve()
        rows.append(state(p, upper, contact) | {"iterations": problem.num_iterations})
        if look is not None:
            look(contact, rows[-1])
    problem.destroy()
    work = rows[-1]["ratio"] * p.mu * LOAD * (rows[-1]["shift"] - rows[-2]["shift"])
    return {
        "friction_force_error": abs(rows[-1]["ratio"] - 1),
        "partial_slip_seen": int(any(0 < row["slip"] < 1 for row in rows)),
        "min_dissipation": min(row["least"] for row in rows) / work,
        "stick_dissipation": max(abs(row["stick_energy"]) for row in rows) / work,
        "energy_error": rows[-1]["step_energy"] / work - 1,
        "force_balance_error": max(row["balance"] for row in rows),
        "snes_iterations": sum(row["iterations"] for row in rows),
    }, rows


def main():
    command = Command(__doc__, Parameters, plot="draw the friction in three states")
    p, a = command.parse()
    if not p.mu > 0:
        command.error("--mu must be positive")
    look = pictures.Friction(p.mu * LOAD) if a.plot else None
    result, rows = run(p, look=look)
    tables.block_on_block(rows)
    report(result, a.json, ".3g")
    if a.plot:
        look.draw(a.plot)
    if result["min_dissipation"] < -1e-12 or result["stick_dissipation"] > 1e-12:
        sys.exit("friction takes energy without slip, or gives energy back")


if __name__ == "__main__":
    main()
