"""Ratio of quasi-symmetric to master-slave errors of the patch test, for all pairs of mesh sizes.

For each cell type of the material (elastic: tetrahedra and hexahedra; Newtonian: triangles and
tetrahedra), load and jitter, and both sides: the largest ratio of the mean errors and of the
maximum errors where the master is finer than the slave, and the median ratio of the mean errors
over all pairs; and the largest ratio of the mean errors on the master's side alone, again where it
is finer. Pairs with a master-slave mean error below 1e-4 (matching and nested meshes) do not count.

    python3 bench/patch_scan.py --penalty 3e7
    python3 bench/patch_scan.py --material newtonian
"""

import argparse
import itertools
import pathlib
import sys

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

from patch_test import Parameters, run, stiffness

CELLS = {"elastic": ("tetrahedron", "hexahedron"), "newtonian": ("triangle", "tetrahedron")}


def ratios(sizes, **parameters):
    """Return error ratios, a row for each pair and side: master > slave, mean, maximum, side."""
    rows = []
    for master, slave in itertools.product(sizes, sizes):
        quasi, ms = (
            run(Parameters(master, slave, formulation=f, **parameters))[0]
            for f in ("quasi-symmetric", "master-slave")
        )
        for side in ("slave", "master"):
            mean, maximum = f"{side}_mean_error", f"{side}_max_error"
            if ms[mean] > 1e-4:
                both = (quasi[name] / ms[name] for name in (mean, maximum))
                rows.append((master > slave, *both, side == "master"))
    return np.array(rows)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--material", choices=tuple(CELLS), default="elastic")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(range(3, 10)))
    parser.add_argument("--penalty", type=stiffness, default="auto", metavar="auto|FLOAT")
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()

    rank = MPI.COMM_WORLD.rank
    if rank == 0:
        heads = "  worst mean  worst max  median mean  worst mean, master"
        print(f"{'cell':13}{'load':14}{'jitter':>6}{heads}")
    everything = []
    for cell, load, jitter in itertools.product(
        CELLS[a.material], ("pressure", "displacement"), (0.0, 0.25)
    ):
        rows = ratios(
            a.sizes,
            cell=cell,
            load=load,
            jitter=jitter,
            seed=a.seed,
            penalty=a.penalty,
            material=a.material,
        )
        everything.append(rows)
        worst = rows[rows[:, 0] > 0].max(axis=0)
        master = rows[(rows[:, 0] > 0) & (rows[:, 3] > 0), 1].max()
        if rank == 0:
            text = f"{worst[1]:12.3f}{worst[2]:11.3f}{np.median(rows[:, 1]):13.3f}{master:20.3f}"
            print(f"{cell:13}{load:14}{jitter:6.2f}{text}", flush=True)
    if rank == 0:
        median = np.median(np.concatenate(everything)[:, 1])
        print(f"median over everything {median:.3f}")


if __name__ == "__main__":
    main()
