"""Define the jobs' names, and the arguments and results of all drivers."""

import json

import cubes
import numpy as np
import sphere

JOBS = {"cubes": cubes, "hertz": sphere}


def unknowns(sizes):
    """Return the number of displacements of both bodies, including those with conditions."""
    return sum(3 * (n + 1) ** 3 for n in sizes)


def penalty(job, sizes, factor):
    """Return the penalty (stress/length): `factor` times the larger E over the upper cell size."""
    return factor * max(job.E) / job.cell_size(sizes[1])


def add_arguments(parser):
    """Add the arguments of every driver."""
    parser.add_argument("--job", choices=tuple(JOBS), default="cubes")
    parser.add_argument("--sizes", required=True, help="cells along an edge, LOWER,UPPER")
    parser.add_argument("--output", metavar="FILE", help="write the displacements here (.npz)")


def parse(parser):
    """Parse the arguments of a driver; return them with the job and its sizes."""
    p = parser.parse_args()
    p.job, p.sizes = JOBS[p.job], [int(n) for n in p.sizes.split(",")]
    return p


def report(output, u, contact=None, **row):
    """Print the result for the benchmark.

    Args:
        output: File for the displacements, or None.
        u: Displacements of the nodes of the lower and then of the upper body, shape (nodes, 3).
        contact: Contact forces of the program, if they differ from the internal forces: arguments
            of ``hertz_error.measure``.
        row: Results.
    """
    if output:
        np.savez(output, u=np.asarray(u, dtype=np.float64), **(contact or {}))
    print("RESULT " + json.dumps(row), flush=True)
