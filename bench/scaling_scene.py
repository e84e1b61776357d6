"""Measure the scenes of bench/scaling.py in the processes that it starts."""

import resource
import time

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from two_blocks import PRESS, box, clamp, residual, two_bodies

import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

import qsdolfinx as qs
from qsdolfinx.linear.presets import AGGREGATION, EXACT
from qsdolfinx.solve.snes import SNES_OPTIONS
from qsdolfinx.system.compiling import Compiling

COMM = MPI.COMM_WORLD
E = 1e4


#: Directions of the cuts of a partition; None for DOLFINx's own partition.
CUTS = {"graph": None, "across": np.eye(3)[:2], "along": np.eye(3)[2:]}


def create(p, n, low, high):
    """Make the mesh of a box, partitioned as --partition requests."""
    msh, directions = box(p.cell, n, low, high), CUTS[p.partition]
    return msh if directions is None else qs.repartition(msh, directions)[0]


def bonded_cells(unknowns):
    """Return the cells along x of the matching body that has about as many unknowns."""
    return min(range(2, 400), key=lambda m: abs(3 * (m + 1) ** 2 * (2 * m + 1) - unknowns))


def measure(model, p):
    """Return the row of the model with p.cells cells along an edge of the lower cube."""
    n = p.cells, round(0.8 * p.cells)
    unknowns = sum(3 * (k + 1) ** 3 for k in n)
    warm_up(p)
    row = bonded_row(bonded_cells(unknowns), p) if model == "bonded" else contact(model, n, p)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row["MiB"] = COMM.allreduce(used, op=MPI.SUM)
    return {"model": model, "ranks": COMM.size, "cells": p.cells} | row


def warm_up(p):
    """Compile the forms."""
    V = fem.functionspace(box(p.cell, 2, 0.0, 1.0), ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = residual(u, v, E)
    compiling = Compiling()
    compiling.form(F), compiling.form(ufl.derivative(F, u))


def largest(value):
    return COMM.allreduce(value, op=MPI.MAX)


def bonded_row(n, p):
    """Solve one body as exactly as the bodies in contact; a first run gives the reactions."""
    tolerance = SNES_OPTIONS["snes_rtol"] * bonded(n, p)["reactions"]
    return bonded(n, p, tolerance)


def bonded(n, p, tolerance=None):
    """Solve one body with DOLFINx, by PETSc's linear solver.

    Args:
        n: Number of cells along x.
        p: Options.
        tolerance: Norm of the residual; None for a fraction of the right-hand side's norm.
    """
    msh = create(p, n, 0.0, 2.0)
    COMM.barrier()
    start, busy = time.perf_counter(), time.process_time()
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    bcs = [clamp(V, 0.0, 0.0), clamp(V, 2.0, PRESS)]
    F = residual(u, v, E)
    compiling = Compiling()
    a = compiling.form(ufl.derivative(F, u))
    before = time.perf_counter()
    A = fem_petsc.assemble_matrix(a, bcs)
    A.assemble()
    for bc in bcs:
        bc.set(u.x.array)
    b = fem_petsc.assemble_vector(compiling.form(-F))
    b.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)
    assembly = time.perf_counter() - before
    for bc in bcs:
        dofs = bc.dof_indices()[0]  # DOLFINx 0.9 may count too many of them as owned
        b.array[dofs[dofs < b.local_size]] = 0
    x, coordinates = A.createVecs()
    coordinates.setBlockSize(3)
    coordinates.array[:] = V.tabulate_dof_coordinates()[: coordinates.local_size // 3].ravel()
    A.setNearNullSpace(PETSc.NullSpace().createRigidBody(coordinates))
    before = time.perf_counter()
    ksp = solver(A)
    if tolerance is not None:
        ksp.setTolerances(rtol=0.0, atol=tolerance)
    ksp.setUp()
    set_up = time.perf_counter() - before
    ksp.solve(b, x)
    solve = time.perf_counter() - before
    seconds, busy = time.perf_counter() - start, time.process_time() - busy
    assert ksp.getConvergedReason() > 0
    iterations = ksp.getIterationNumber()
    u.x.array[: x.local_size] += x.array_r
    u.x.scatter_forward()
    left, reactions = forces(F, bcs)
    unknowns = A.getSize()[0]
    for thing in (ksp, A, b, x, coordinates):
        thing.destroy()
    stages = dict.fromkeys(("pairing", "gap", "insertion", "conversion"), 0.0)
    stages |= {"bulk assembly": largest(assembly), "solve": largest(solve)}
    return {
        "unknowns": unknowns,
        "seconds": largest(seconds),
        "processor": largest(busy),
        "stages": stages,
        "set_up": largest(set_up),
        "newton": 1,
        "iterations": iterations,
        "reactions": reactions,
        "residual": left / reactions,
        "points": 0,
    }


def forces(F, bcs):
    """Return norms of a form's vector without and within the rows of Dirichlet conditions."""
    b = fem_petsc.assemble_vector(fem.form(F))
    b.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)
    held = np.zeros(b.local_size, dtype=bool)
    for bc in bcs:
        dofs = bc.dof_indices()[0]
        held[dofs[dofs < b.local_size]] = True
    squares = [float(part @ part) for part in (b.array_r[~held], b.array_r[held])]
    b.destroy()
    return np.sqrt(COMM.allreduce(np.array(squares), op=MPI.SUM)).tolist()


def solver(A):
    """Make CG with the multigrid of the preset "amg", for a matrix."""
    ksp = PETSc.KSP().create(COMM)
    ksp.setOptionsPrefix("bonded_")
    database = PETSc.Options("bonded_")
    for key, value in ({"ksp_type": "cg", "ksp_rtol": EXACT} | AGGREGATION).items():
        database.setValue(key, value)
    ksp.setOperators(A)
    ksp.setFromOptions()
    ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
    return ksp


def contact(model, n, p):
    """Solve two bodies in contact."""
    meshes = [create(p, count, float(i), i + 1.0) for i, count in enumerate(n)]
    COMM.barrier()
    start, busy = time.perf_counter(), time.process_time()
    forms, u, bcs, surfaces = two_bodies(meshes, (E, E))
    law = qs.Tied() if model == "tied" else qs.Unilateral()
    pair = qs.Contact(
        surfaces[1], surfaces[0], law=law, quadrature=p.quadrature, enforcement=p.enforcement
    )
    options = {"ksp_rtol": 1e-8} if p.exact else {}
    problem = qs.ContactProblem(forms, u, [pair], bcs, linear_solver="amg", petsc_options=options)
    counts = Count(problem.snes.getKSP())
    problem.solve()
    seconds, busy = time.perf_counter() - start, time.process_time() - busy
    measures, _ = problem.newton.measure()
    gap = problem.violation_history[-1] / pair.slave.facet_size_range[0] if pair.augmented else None
    stages = {name: span.max for name, span in problem.timings.items()}
    points = largest(len(pair.pairing.slave.x))
    return {
        "unknowns": problem.system.x.getSize(),
        "seconds": largest(seconds),
        "processor": largest(busy),
        "stages": stages,
        "newton": problem.num_iterations,
        "iterations": problem.num_linear_iterations,
        "most_iterations": max(counts.iterations),
        "augmentations": problem.num_augmentations,
        "gap": gap,
        "residual": float((measures.residuals / measures.sizes).max()),
        "points": points,
        "force": abs(float(pair.force("slave")[2])),
    }


class Count:
    """Return the iterations of each linear solve."""

    def __init__(self, ksp):
        self.iterations = []
        ksp.setMonitor(self)

    def __call__(self, ksp, iteration, norm):
        if iteration == 0:
            self.iterations.append(0)
        else:
            self.iterations[-1] = iteration
