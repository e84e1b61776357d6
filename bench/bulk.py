"""Time the assembly of bodies: options of the C compiler, quadrature degrees, PETSc's insertion.

A cube of --cells³ cells: its tangent is assembled with the options of DOLFINx and with those of
qsdolfinx, with the degree that UFL estimates and with the usual one (as in the warning of
qsdolfinx), and with one point and a zero integrand, which leaves little but the insertion. µs of
CPU time for each cell, the least of three assemblies; `error` is the largest difference between
the entries of both options over the largest entry.

    python3 bench/bulk.py --cells 24 --json bench/results/bulk.json
"""

import argparse
import pathlib
import sys
import time

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import numpy as np
from machine import circumstances, write

import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc

from qsdolfinx.system.compiling import Compiling

OPTIONS = {
    "DOLFINx": Compiling(jit_options={"cffi_extra_compile_args": ["-O2", "-g0"]}),
    "qsdolfinx": Compiling(),
}
FORMS = ("linear", "neo-Hookean", "zero")


def tangent(kind, V, degree):
    """Tangent of a body of this kind, with a quadrature degree, or None for that of UFL."""
    dx = ufl.dx if degree is None else ufl.dx(metadata={"quadrature_degree": degree})
    u, v, w = fem.Function(V), ufl.TestFunction(V), ufl.TrialFunction(V)
    if kind == "zero":
        return fem.Constant(V.mesh, 0.0) * ufl.inner(v, w) * dx
    if kind == "linear":
        e = ufl.sym(ufl.grad(w))
        return ufl.inner(2 * e + 1.5 * ufl.tr(e) * ufl.Identity(3), ufl.grad(v)) * dx
    u.x.array[:] = 1e-3 * np.random.default_rng(1).standard_normal(u.x.array.size)
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    W = (ufl.tr(F.T * F) - 3) / 2 - ufl.ln(J) + 0.75 * ufl.ln(J) ** 2
    return ufl.derivative(ufl.derivative(W * dx, u), u)


def timed(form, kind):
    """Seconds of the fastest of three assemblies, and the matrix."""
    matrix, seconds = petsc.create_matrix(form, kind), []
    for _ in range(3):
        matrix.zeroEntries()
        start = time.process_time()
        petsc.assemble_matrix(matrix, form)
        matrix.assemble()
        seconds.append(time.process_time() - start)
    return min(seconds), matrix


def rows(cells, kind):
    """Rows of the table for one type of cell."""
    cell = mesh.CellType[kind]
    msh = mesh.create_box(MPI.COMM_SELF, [[0] * 3, [1] * 3], [cells] * 3, cell)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    number = msh.topology.index_map(3).size_local
    usual = 3 if kind == "hexahedron" else 2
    for name in FORMS:
        for degree in (0,) if name == "zero" else (None, usual):
            row = {"cell": kind, "form": name, "degree": "UFL" if degree is None else degree}
            found = []
            for options, compiling in OPTIONS.items():
                form = compiling.form(tangent(name, V, degree))
                for storage in ("aij", "baij"):
                    seconds, matrix = timed(form, storage)
                    row[f"{options}, {storage}"] = seconds / number * 1e6
                found.append(matrix)
            largest = found[0].norm(norm_type=3)
            found[0].axpy(-1, found[1])
            row["error"] = found[0].norm(norm_type=3) / largest if largest else 0.0
            yield row


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=24, help="cells in each direction")
    parser.add_argument("--json", type=pathlib.Path, help="write the rows to a file")
    args = parser.parse_args()
    table = []
    for kind in ("hexahedron", "tetrahedron"):
        for row in rows(args.cells, kind):
            if not table:
                print(*(f"{key:>16}" for key in row))
            shown = (f"{v:16.3g}" if isinstance(v, float) else f"{v:>16}" for v in row.values())
            print(*shown, flush=True)
            table.append(row)
    if args.json:
        write(args.json, {"circumstances": circumstances(1), "rows": table})


if __name__ == "__main__":
    main()
