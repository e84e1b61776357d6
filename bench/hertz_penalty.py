"""Study Hertz contact (two cylinders) over penalty and kind of normals, to choose the defaults.

Prints, for three mesh sizes around h, the worst L2 error in % of the recovered traction on the
slave and on the master side.

    python3 bench/hertz_penalty.py
"""

import itertools
import pathlib
import sys

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

from hertz import Parameters, run
from hertz_bodies import E

FACTORS = (1, 3, 5, 10, 30, 100)


def main(h=0.025, case="cylinders"):
    rank = MPI.COMM_WORLD.rank
    if rank == 0:
        print(f"{'formulation':17}{'quadrature':11}{'constraints':13}{'normals':9}", "ε h / E =")
        print(" " * 50 + "".join(f"{f:>14}" for f in FACTORS))
    kinds = itertools.product(
        ("master-slave", "quasi-symmetric"),
        (("nodal", "nodes"), ("overlay", "nodes"), ("overlay", "points")),
        ("facet", "bisector"),
    )
    for formulation, (quadrature, constraints), normals in kinds:
        cells = []
        for factor in FACTORS:
            worst = [0.0, 0.0]
            for size in (0.9 * h, h, 1.1 * h):
                p = Parameters(
                    case=case,
                    h=size,
                    formulation=formulation,
                    quadrature=quadrature,
                    normals=normals,
                    constraints=constraints,
                    penalty=factor * E / size,
                )
                r, _ = run(p)
                errors = r["l2_error_slave"], r["l2_error_master"]
                worst = [max(w, e) for w, e in zip(worst, errors, strict=True)]
            cells.append(f"{100 * worst[0]:6.2f}/{100 * worst[1]:5.2f}")
        if rank == 0:
            line = "".join(f"{cell:>14}" for cell in cells)
            print(f"{formulation:17}{quadrature:11}{constraints:13}{normals:9}{line}", flush=True)


if __name__ == "__main__":
    main()
