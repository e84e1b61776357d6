"""Convergence test of Fourment & Popa (2005), Figure 2: upsetting of two identical elastic blocks.

Two blocks of 2 × 1 are stacked and upset between clamped dies in plane strain: u = 0 at the bottom,
u = (0, −δ) at the top, free sides, E = 1, ν = 0.3. By symmetry the right half is modelled, with
u_x = 0 on x = 0. The lower block is the master, the upper one the slave. A ratio of 2:3 means 2
cells of the master to 3 of the slave along the interface. The blocks are tied, so that the exact
solution is that of a single body. It is computed with cubic elements on a mesh that contains all
other meshes, so that errors are integrated there without interpolation error. The results, relative
to the values of the single body, are the energy norm of the error of both blocks, and the L2 norm
of the error of the recovered normal traction over the interface, ends included, for both sides.

Meshes are graded towards the singular corner of the die, with cells of size h^1.5 there.

    python3 demos/upsetting_convergence.py --plot upsetting.png
    mpirun -n 2 python3 demos/upsetting_convergence.py --levels 3 --json result.json

The JSON object is flat. With ratio R ("2:3" and so on), formulation F as in qs.Contact, level L
from 0 and N one of energy, slave_traction and master_traction, it has "error_N_F_R_L",
"rate_N_F_R", "h_R_L" (1 / cells of the coarser side), "error_energy_single_L" and
"rate_energy_single" (a single body with the cells of 1:1), "reference_energy_error" (cubic against
quadratic elements), "total_seconds" and the parameters.
"""

import dataclasses
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.command import FORMULATIONS, Command, option, save
from upsetting_bodies import Body, E, Reference, create_mesh, locate

# This demo measures the error of nodal sampling with a finer master, so ignore its warning.
warnings.filterwarnings("ignore", "quadrature: ", qs.ContactWarning)

NORMS = ("energy", "slave_traction", "master_traction")
# Numbers of cells of master and slave along the interface on level 0; each level halves the size.
# All numbers are divisors of FINEST, the number of cells of the reference.
CELLS = {"1:1": (6, 6), "2:3": (4, 6), "3:2": (6, 4), "1:4": (3, 12), "4:1": (12, 3)}
FINEST = 12


@dataclasses.dataclass
class Parameters:
    """Parameters of the study; the penalty is penalty_factor · E / (smallest facet).

    With the mean facet size instead, the penalty would be soft for facets at the graded end of the
    interface, and the penalty instead of the meshes would limit the accuracy of the traction.
    """

    levels: int = option(4, "number of meshes for each ratio, at least 2")
    grading: float = option(1.5, "1: uniform meshes")
    penalty_factor: float = option(1e3, "ε h / E")


def errors(reference, master, slave, formulation, penalty_factor):
    """Tie two bodies; return the errors in the order of NORMS."""
    bodies = slave, master
    surfaces = [qs.Surface(b.V, facets=locate(b.mesh, 1, 0.0)) for b in bodies]
    penalty = penalty_factor * E / min(s.facet_size_range[0] for s in surfaces)
    options = {"quadrature": "nodal", "enforcement": "penalty"}
    contact = qs.Contact(
        *surfaces, formulation=formulation, law=qs.Tied(), penalty=penalty, **options
    )
    for body in bodies:
        body.u.x.array[:] = 0
    F, u, bcs = ([getattr(b, name) for b in bodies] for name in ("F", "u", "bcs"))
    qs.ContactProblem(F, u, [contact], bcs).solve()
    sides = dict(zip(("slave", "master"), bodies, strict=True))
    energy = sum(reference.energy_error(body.u, [side]) for side, body in sides.items())
    tractions = [reference.traction_error(contact.traction(side), side) for side in sides]
    return [float(value) for value in (np.sqrt(energy), *tractions)]


def rate(h, error):
    """Fit the exponent of h to the errors on all levels (least squares of the logarithms)."""
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


def run(p, comm=MPI.COMM_WORLD):
    """Solve everything; return the results for --json."""
    reference = Reference(comm, FINEST * 2 ** (p.levels - 1), p.grading)
    result = dataclasses.asdict(p) | {"reference_energy_error": float(reference.error)}
    levels, single = range(p.levels), []
    for level in levels:
        body = Body(create_mesh(comm, CELLS["1:1"][0] * 2**level, -1, 1, p.grading))
        error = reference.energy_error(body.solve(), ("master", "slave"))
        single.append(float(np.sqrt(error)))
        result[f"error_energy_single_{level}"] = single[-1]
    for ratio, (n_master, n_slave) in CELLS.items():
        h = [1 / (min(n_master, n_slave) * 2**level) for level in levels]
        result |= {f"h_{ratio}_{level}": h[level] for level in levels}
        found = {}
        for level in levels:
            master = Body(create_mesh(comm, n_master * 2**level, -1, 0, p.grading))
            slave = Body(create_mesh(comm, n_slave * 2**level, 0, 1, p.grading))
            for f in FORMULATIONS:
                values = errors(reference, master, slave, f, p.penalty_factor)
                for norm, value in zip(NORMS, values, strict=True):
                    result[f"error_{norm}_{f}_{ratio}_{level}"] = value
                    found.setdefault(f"{norm}_{f}_{ratio}", []).append(value)
        if ratio == "1:1":
            found["energy_single"] = single
        result |= {f"rate_{key}": rate(h, values) for key, values in found.items()}
    return result


def main():
    command = Command(__doc__, Parameters, plot="draw errors over h")
    p, a = command.parse()
    if p.levels < 2 or p.grading < 1 or p.penalty_factor <= 0:
        command.error(
            "--levels must be at least 2, --grading at least 1, --penalty-factor positive"
        )
    start = time.perf_counter()
    result = run(p)
    result["total_seconds"] = time.perf_counter() - start
    tables.upsetting_convergence(result, CELLS, NORMS)
    save(result, a.json)
    if a.plot:
        pictures.upsetting_convergence(a.plot, result, CELLS, NORMS)
    tables.check_upsetting(result, CELLS)


if __name__ == "__main__":
    main()
