"""Speed against error: the patch test on finer and finer meshes with each formulation.

For each mesh the formulations alternate, and the best time of the repeats is kept. Contact time is
pairing, gaps and insertion; the ratio to the whole is what a user pays for contact, apart from the
denser matrix. The stress of cells as high as the block averages the error of nodal forces out, and
falls; that of the nodal forces themselves does not, since the meshes stay non-matching.

    mpirun -n 2 python3 bench/speed_against_error.py --cell tetrahedron --sizes 10 20 40
"""

import argparse
import json
import pathlib
import sys

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

from patch_test import CELLS, Parameters, run

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cell", choices=CELLS, default="hexahedron")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 40, 80])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", metavar="FILE")
    a = parser.parse_args()

    comm = MPI.COMM_WORLD
    rows = []
    if comm.rank == 0:
        print(f"{comm.size} ranks, {a.cell}; slave error: mean / nodal maximum")
        print(
            f"{'master × slave':>15} {'dofs':>8}  {'formulation':16}{'slave error':>20}"
            f"{'total':>9}{'contact':>9}{'share':>7}"
        )
    for n in a.sizes:
        best = {}
        for _ in range(a.repeats):
            for f in FORMULATIONS:
                p = Parameters(master=n, slave=max(1, 3 * n // 5), cell=a.cell, formulation=f)
                r, _ = run(p, comm)
                if f not in best or r["total_seconds"] < best[f]["total_seconds"]:
                    best[f] = r
        rows += best.values()
        for f, r in best.items():
            if comm.rank == 0:
                share = r["contact_seconds"] / r["total_seconds"]
                error = f"{r['slave_mean_error']:.2e} / {r['slave_nodal_max_error']:.2e}"
                print(
                    f"{r['n_master']:9} × {r['n_slave']:3} {r['dofs']:8}  {f:16}{error:>20}"
                    f"{r['total_seconds']:8.3f}s{r['contact_seconds']:8.4f}s{100 * share:6.1f}%",
                    flush=True,
                )
    if comm.rank == 0 and a.json:
        with open(a.json, "w") as file:
            json.dump(rows, file, indent=2)


if __name__ == "__main__":
    main()
