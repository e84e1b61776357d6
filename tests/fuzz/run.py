"""Random small scenes through contact detection and assembly, and through a full solve.

Two random convex bodies with random meshes, or boxes face to face, have a random pose and
partition, and a random formulation, quadrature and law. The seed determines everything. Checks of
each scene:

- contact pairs against brute force over all facets; on the overlay nothing lies between two
  paired points, and no area counts twice;
- balance of forces; balance of moments, up to the part of points that do not face each other
  exactly; symmetric, positive semi-definite blocks that are the residual's derivative;
- on several ranks: the same sums as on one rank. The digest printed at the end is the same, too.

Solves (--solves) have elastic bodies; each ends in equilibrium or with a reason.

    python3 tests/fuzz/run.py --scenes 1000 --solves 100
    mpirun -n 3 python3 tests/fuzz/run.py --scenes 1000 --solves 100 --first 5000
"""

import argparse
import gc
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))

from fuzz.bodies import random_scene
from fuzz.checks import check_scene

import qsdolfinx as qs

COMM = MPI.COMM_WORLD

#: Sums in another order differ by rounding alone.
SAME = 1e-9


def run(check, seed, indices, report):
    """Check scenes on all ranks, and on one rank for comparison. Collective.

    Args:
        check: Function of a communicator and a scene that returns its numbers and faults.
        seed: Seed of the scenes.
        indices: Numbers of the scenes.
        report: Called on rank 0 with a line for each scene that has faults.

    Returns:
        The number of scenes with faults, the number of refused scenes, and the digest: a sum over
        all scenes.
    """
    indices = list(indices)
    alone = {}
    if COMM.size > 1:
        for i in indices[COMM.rank :: COMM.size]:
            alone[i] = attempt(check, MPI.COMM_SELF, random_scene(seed, i))
    failed, refused, digest = 0, 0, 0.0
    for n, i in enumerate(indices):
        if n % 50 == 0:  # on all ranks at once: see tests/conftest.py
            gc.collect()
        scene = random_scene(seed, i)
        numbers, faults = attempt(check, COMM, scene)
        if COMM.size > 1:
            expected, _ = COMM.bcast(alone.get(i), root=n % COMM.size)
            if (expected is None) != (numbers is None):
                faults.append("not the same outcome as on one rank")
            elif numbers is not None:
                faults += [f"not as on one rank: {f}" for f in numbers.faults(expected, SAME)]
        faults = sorted({fault for part in COMM.allgather(faults) for fault in part})
        digest += 0.0 if numbers is None else numbers.digest
        refused += numbers is not None and numbers.refused is not None
        if faults:
            failed += 1
            if COMM.rank == 0:
                report(f"{scene.words}: {'; '.join(faults)}")
    return failed, refused, digest


def attempt(check, comm, scene):
    """Numbers and faults of a check; an exception is a fault."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", qs.ContactWarning)  # scenes are unusual on purpose
            return check(comm, scene)
    except Exception as error:
        return None, [f"{type(error).__name__}: {str(error)[:300]}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=300, help="through pairing and assembly")
    parser.add_argument("--solves", type=int, default=0, help="through a full solve")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    kinds = [("pairing and assembly", check_scene, args.scenes)]
    if args.solves:
        from fuzz.solve import check_solve

        kinds.append(("full solve", check_solve, args.solves))
    total = 0
    for name, check, count in kinds:
        start = time.perf_counter()
        failed, refused, digest = run(
            check, args.seed, range(args.first, args.first + count), print
        )
        seconds = time.perf_counter() - start
        total += failed
        if COMM.rank == 0 and count:
            print(
                f"{name}: {count} scenes on {COMM.size} rank(s), {failed} with faults, "
                f"{refused} refused, "
                f"digest {digest:.8f}, {1e3 * seconds / count:.1f} ms each",
                flush=True,
            )
    sys.exit(min(total, 1))


if __name__ == "__main__":
    main()
