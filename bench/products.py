"""Time products with a body's matrix: PETSc's formats, and those of qsdolfinx.

A row for each type of cell: milliseconds for a product, the least of --repeats.

    python3 bench/products.py --cells 26
"""

import argparse
import time

from mpi4py import MPI
from petsc4py import PETSc

import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc

from qsdolfinx import _cpp
from qsdolfinx.system.compiling import Compiling

CELLS = ("hexahedron", "tetrahedron", "quadrilateral")


def matrix_of(kind, cells):
    """Elastic body's matrix in blocks, and its form; squares have as many unknowns as cubes."""
    cell, comm = mesh.CellType[kind], MPI.COMM_SELF
    if kind == "quadrilateral":
        n = round((1.5 * cells**3) ** 0.5)
        msh = mesh.create_unit_square(comm, n, n, cell)
    else:
        msh = mesh.create_unit_cube(comm, cells, cells, cells, cell)
    V = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    form = Compiling().form(ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx(degree=3))
    matrix = petsc.create_matrix(form, "baij")
    petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix, form


def fastest(product, repeats):
    """Milliseconds of the fastest call."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        product()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=26, help="cells along an edge of the cube")
    parser.add_argument("--repeats", type=int, default=30, help="number of products")
    args = parser.parse_args()
    formats = ("aij", "baij", "sbaij")
    columns = *formats, *(f"ours, {name}" for name in formats[1:])
    print(f"{'cell':>14} {'unknowns':>9}", *(f"{name:>12}" for name in columns))
    for kind in CELLS:
        matrix, _form = matrix_of(kind, args.cells)  # PETSc needs the mesh's communicator
        x, y = matrix.createVecs()
        x.set(1.0)
        theirs, ours = [], []
        for name in formats:
            other = matrix if name == "baij" else matrix.convert(name, PETSc.Mat())
            theirs.append(fastest(lambda A=other: A.mult(x, y), args.repeats))
            if name != "aij":
                own = _cpp.BlockProduct(other.handle)
                ours.append(fastest(lambda B=own: B.apply(x.handle, y.handle), args.repeats))
        print(f"{kind:>14} {x.getSize():9}", *(f"{ms:12.2f}" for ms in theirs + ours))


if __name__ == "__main__":
    main()
