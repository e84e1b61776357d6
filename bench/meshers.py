"""Compare remeshing with tetrahedra by gmsh, with our surface mesher, and by MMG, if installed.

A box, a ball and a deformed quarter of a cylinder are remeshed with a given size. A row for each
body and mesher: number of cells, shape of the worst cell and mean shape (1 at best), fraction of
edge lengths between 0.7 and 1.4 of the requested size, relative change of the volume before nodes
are moved to restore it, and seconds, the least of --repeat.

    python3 bench/meshers.py --json meshers.json
"""

import argparse
import pathlib
import sys
import time

sys.path.append(str(pathlib.Path(__file__).resolve().parent))
sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "tests"))
sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

from mpi4py import MPI

import numpy as np
from forming_bodies import quarter_cylinder
from machine import circumstances, write
from remeshing_scenes import bump

from dolfinx import mesh

import qsdolfinx as qs
from qsdolfinx.compat import cell_nodes
from qsdolfinx.remeshing import mmg


def box():
    """Make a box of 1 by 2 by 3."""
    return mesh.create_box(MPI.COMM_WORLD, [[0, 0, 0], [1, 2, 3]], [3, 6, 8])


def ball():
    """Make a ball of radius 1, from a cube of tetrahedra."""
    out = mesh.create_box(MPI.COMM_WORLD, [[-1, -1, -1], [1, 1, 1]], [8, 8, 8])
    x = out.geometry.x
    x *= (np.max(np.abs(x), axis=1) / np.maximum(np.linalg.norm(x, axis=1), 1e-300))[:, None]
    return out


def quarter():
    """Make a quarter of a cylinder of radius 10 and height 15, with waves."""
    out = quarter_cylinder(MPI.COMM_WORLD, 10.0, 0.0, 15.0, 2.0)
    bump(out, 0.4, 15.0)
    return out


BODIES = {"box": (box, 0.3), "ball": (ball, 0.2), "quarter of a cylinder": (quarter, 1.5)}
COLUMNS = "cells", "worst", "mean", "near_size", "unrestored", "seconds"


def shapes(msh):
    """Return the quality of cells, 6√2 V over the cube of the RMS edge length, and their edges."""
    p = msh.geometry.x[cell_nodes(msh)]
    a, b, c = (p[:, i] - p[:, 0] for i in (1, 2, 3))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6
    edges = np.array(
        [np.linalg.norm(p[:, i] - p[:, j], axis=1) for i in range(4) for j in range(i)]
    )
    return 6 * np.sqrt(2) * volume / np.sqrt(np.mean(edges**2, axis=0)) ** 3, edges


def row(name, mesher, repeat):
    """Run one mesher on one body."""
    make, size = BODIES[name]
    seconds = []
    for _ in range(repeat):
        msh = make()
        start = time.perf_counter()
        made = qs.remesh(msh, size, mesher=mesher)
        seconds.append(time.perf_counter() - start)
    shape, edges = shapes(made.mesh)
    near = np.mean((edges > 0.7 * size) & (edges < 1.4 * size))
    report = made.report
    return {
        "body": name,
        "mesher": mesher,
        "cells": report.num_cells,
        "worst": report.quality,
        "mean": float(np.mean(shape)),
        "near_size": float(near),
        "unrestored": report.unrestored,
        "seconds": min(seconds),
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", metavar="FILE")
    p = parser.parse_args()
    meshers = ["gmsh"] + ["mmg"] * (mmg.program() is not None)
    print(f"{'body':24}{'mesher':8}" + "".join(f"{name:>12}" for name in COLUMNS))
    rows = []
    for name in BODIES:
        for mesher in meshers:
            rows.append(row(name, mesher, p.repeat))
            text = "".join(f"{rows[-1][column]:12.3g}" for column in COLUMNS)
            print(f"{name:24}{mesher:8}{text}", flush=True)
    if p.json:
        write(p.json, circumstances(1) | {"rows": rows})


if __name__ == "__main__":
    main()
