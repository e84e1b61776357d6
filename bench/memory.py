"""Measure memory over pair updates and time steps: of the process, its heap and PETSc.

Two blocks update their contact pairs again and again, with either quadrature and with friction; a
viscous block on an elastic die is pressed in small steps. Memory is read after a tenth of the steps
and at the end. Printed is the growth per step, the largest of all ranks.

    python3 bench/memory.py
    mpirun -n 2 python3 bench/memory.py --count 300
"""

import argparse
import ctypes
import gc
import pathlib
import sys

import petsc4py

petsc4py.init([sys.argv[0], "-malloc_debug"])  # makes PETSc count its allocations

from mpi4py import MPI  # noqa: E402
from petsc4py import PETSc  # noqa: E402

import numpy as np  # noqa: E402

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "tests"))

from scenes import Pair  # noqa: E402
from step_scenes import Upset  # noqa: E402

import qsdolfinx as qs  # noqa: E402

COMM = MPI.COMM_WORLD
PAGE = 4096


class Heap(ctypes.Structure):
    """struct mallinfo2 of the C library."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks "
        "keepcost".split()
    )


def usage():
    """Return bytes of the process in memory, of its heap in use, and of PETSc's objects."""
    gc.collect()
    PETSc.garbage_cleanup()
    resident = int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * PAGE
    libc, petsc, bytes_ = ctypes.CDLL(None), ctypes.CDLL(PETSc.__file__), ctypes.c_double()
    libc.mallinfo2.restype = Heap
    heap = libc.mallinfo2()
    petsc.PetscMallocGetCurrentUsage(ctypes.byref(bytes_))
    return np.array([resident, heap.uordblks + heap.hblkhd, bytes_.value])


def growth(step, count):
    """Return the growth in bytes per step after a tenth of the steps, largest rank. Collective."""
    first = max(count // 10, 1)
    for _ in range(first):
        step()
    before = usage()
    for _ in range(count):
        step()
    return np.max(COMM.allgather((usage() - before) / count), axis=0)


def pairing(cell, **options):
    """Return a step that moves a block along the other, there and back, and updates the pairs."""
    options = {"quadrature": "nodal", "enforcement": "penalty"} | options
    pair = Pair(cell, n=(8, 6), wave=0.02, contact_options=options)
    ways = [1e-3, -1e-3]

    def step():
        pair.meshes[1].geometry.x[:, 0] += ways[0]
        ways.reverse()
        pair.contact.update()

    return step


def solving(cell):
    """Return a step that updates the contact pairs and solves, so that matrices are built again."""
    options = {"quadrature": "nodal", "enforcement": "penalty"}
    pair = Pair(cell, n=(5, 4), contact_options=options)
    problem = pair.problem()

    def step():
        pair.contact.update()
        problem.solve()

    return step


def flowing():
    """Return a time step of a viscous block between a rigid plane and an elastic die."""
    scene = Upset(die=True, dt=1e-4, drive=None)
    stepper = qs.TimeStepper(
        scene.problem, 1e-4, lambda t, dt: setattr(scene.tool, "displacement", [0.0, -dt])
    )
    return stepper.step


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="steps of each kind")
    count = parser.parse_args().count
    cases = {
        "re-pairing, nodal, 2D": pairing("triangle"),
        "re-pairing, overlay, 2D": pairing("quadrilateral", quadrature="overlay"),
        "re-pairing, nodal, 3D": pairing("hexahedron"),
        "re-pairing, overlay, 3D": pairing("tetrahedron", quadrature="overlay"),
        "re-pairing, friction, 2D": pairing("triangle", friction=qs.Coulomb(0.2)),
        "pairing and solving, 2D": solving("triangle"),
        "time steps": flowing(),
    }
    if COMM.rank == 0:
        print(f"bytes per step, over {count} steps on {COMM.size} rank(s)")
        print(f"{'':28}{'resident':>10}{'heap':>10}{'PETSc':>10}")
    for name, step in cases.items():
        grown = growth(step, count)
        if COMM.rank == 0:
            print(f"{name:28}" + "".join(f"{value:>10.0f}" for value in grown), flush=True)


if __name__ == "__main__":
    main()
