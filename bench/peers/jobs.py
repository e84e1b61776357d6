"""What all jobs and drivers share: the jobs' names, what drivers are given and what they tell."""

import json

import cubes
import numpy as np
import sphere

JOBS = {"cubes": cubes, "hertz": sphere}


def unknowns(sizes):
    """Displacements of both bodies, held ones included."""
    return sum(3 * (n + 1) ** 3 for n in sizes)


def penalty(job, sizes, factor):
    """Penalty, stress per length: `factor` times E of the stiffer body over h of the upper one."""
    return factor * max(job.E) / job.cell_size(sizes[1])


def add_arguments(parser):
    """What every driver is given."""
    parser.add_argument("--job", choices=tuple(JOBS), default="cubes")
    parser.add_argument("--sizes", required=True, help="cells along an edge, LOWER,UPPER")
    parser.add_argument("--output", metavar="FILE", help="write the displacements here (.npz)")


def parse(parser):
    """What a driver was given, with the job and its sizes."""
    p = parser.parse_args()
    p.job, p.sizes = JOBS[p.job], [int(n) for n in p.sizes.split(",")]
    return p


def report(output, u, contact=None, **row):
    """Print what the bench reads.

    Args:
        output: File for the displacements, or None.
        u: Displacements of the nodes of the lower and then of the upper body, shape (nodes, 3).
        contact: The program's own forces of contact, where they are not those inside the bodies:
            arguments of ``hertz_error.measure``.
        row: Results.
    """
    if output:
        np.savez(output, u=np.asarray(u, dtype=np.float64), **(contact or {}))
    print("RESULT " + json.dumps(row), flush=True)
