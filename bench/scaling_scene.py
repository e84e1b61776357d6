"""The scenes of bench/scaling.py, measured in the processes that it starts."""

import resource
import time

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc as fem_petsc

import qsdolfinx as qs
from qsdolfinx.linear.presets import AGGREGATION, EXACT
from qsdolfinx.system.body import Body
from qsdolfinx.system.rigid_modes import orthonormal, rigid_modes, set_near_nullspace

COMM = MPI.COMM_WORLD
E, NU = 1e4, 0.3
PRESS = -0.02


def box(low, high, n, cell):
    """Mesh of a box [0, 1]² × [low, high] with n cells along x and y, and as long ones along z."""
    corners = [[0.0, 0.0, low], [1.0, 1.0, high]]
    counts = [n, n, round(n * (high - low))]
    return mesh.create_box(COMM, corners, counts, mesh.CellType[cell])


def residual(u, v):
    """Virtual work of linear elasticity."""
    mu, lame = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    strain = ufl.sym(ufl.grad(u))
    stress = lame * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    return ufl.inner(stress, ufl.grad(v)) * ufl.dx


def clamp(V, z, press):
    """Displacement (0, 0, press) of the nodes at a height."""
    facets = mesh.locate_entities_boundary(V.mesh, 2, lambda x: np.isclose(x[2], z))
    dofs = fem.locate_dofs_topological(V, 2, facets)
    return fem.dirichletbc(np.array([0.0, 0.0, press]), dofs, V)


def bonded_cells(unknowns):
    """Cells along x of the matching body that has about as many unknowns."""
    return min(range(2, 400), key=lambda m: abs(3 * (m + 1) ** 2 * (2 * m + 1) - unknowns))


def measure(model, p):
    """Row for the model with p.cells cells along an edge of the lower cube."""
    n = p.cells, round(0.8 * p.cells)
    unknowns = sum(3 * (k + 1) ** 3 for k in n)
    warm_up(p)
    row = bonded(bonded_cells(unknowns), p) if model == "bonded" else contact(model, n, p)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row["MiB"] = COMM.allreduce(used, op=MPI.SUM)
    return {"model": model, "ranks": COMM.size, "cells": p.cells} | row


def warm_up(p):
    """Compile the forms."""
    msh = box(0.0, 1.0, 2, p.cell)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = residual(u, v)
    fem.form(F), fem.form(ufl.derivative(F, u))


def largest(value):
    return COMM.allreduce(value, op=MPI.MAX)


def bonded(n, p):
    """One body of DOLFINx, by PETSc's linear solver."""
    msh = box(0.0, 2.0, n, p.cell)
    COMM.barrier()
    start = time.perf_counter()
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    bcs = [clamp(V, 0.0, 0.0), clamp(V, 2.0, PRESS)]
    F = residual(u, v)
    a = fem.form(ufl.derivative(F, u))
    before = time.perf_counter()
    A = fem_petsc.assemble_matrix(a, bcs)
    A.assemble()
    for bc in bcs:
        bc.set(u.x.array)
    b = fem_petsc.assemble_vector(fem.form(-F))
    b.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)
    assembly = time.perf_counter() - before
    body = Body(F, u, bcs)
    b.array[body.owned_constrained] = 0
    x = A.createVecRight()
    modes = [x.duplicate() for _ in range(6)]
    for mode, values in zip(modes, rigid_modes(body), strict=True):
        mode.array[:] = values
    set_near_nullspace(A, orthonormal(modes))
    before = time.perf_counter()
    ksp = solver(A)
    ksp.setUp()
    set_up = time.perf_counter() - before
    ksp.solve(b, x)
    solve = time.perf_counter() - before
    seconds = time.perf_counter() - start
    assert ksp.getConvergedReason() > 0
    stages = dict.fromkeys(("pairing", "gap", "insertion", "conversion"), 0.0)
    stages |= {"bulk assembly": largest(assembly), "solve": largest(solve)}
    return {
        "unknowns": A.getSize()[0],
        "seconds": largest(seconds),
        "stages": stages,
        "set_up": largest(set_up),
        "newton": 1,
        "iterations": ksp.getIterationNumber(),
        "points": 0,
    }


def solver(A):
    """CG with the multigrid of the preset "amg", for a matrix."""
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
    """Two bodies."""
    meshes = box(0.0, 1.0, n[0], p.cell), box(1.0, 2.0, n[1], p.cell)
    COMM.barrier()
    start = time.perf_counter()
    forms, u, bcs, surfaces = [], [], [], []
    for msh, far, press in zip(meshes, (0.0, 2.0), (0.0, PRESS), strict=True):
        V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        u.append(fem.Function(V))
        forms.append(residual(u[-1], ufl.TestFunction(V)))
        bcs.append([clamp(V, far, press)])
        facets = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], 1.0))
        surfaces.append(qs.Surface(V, facets=facets))
    law = qs.Tied() if model == "tied" else qs.Unilateral()
    pair = qs.Contact(
        surfaces[1], surfaces[0], law=law, quadrature=p.quadrature, enforcement=p.enforcement
    )
    options = {"ksp_rtol": 1e-8} if p.exact else {}
    problem = qs.ContactProblem(forms, u, [pair], bcs, solver="amg", petsc_options=options)
    counts = Count(problem.snes.getKSP())
    problem.solve()
    seconds = largest(time.perf_counter() - start)
    gap = problem.violation_history[-1] / pair.slave.facet_size_range[0] if pair.augmented else None
    stages = {name: span.max for name, span in problem.timings.items()}
    points = largest(len(pair.pairing.slave.x))
    return {
        "unknowns": problem.system.x.getSize(),
        "seconds": seconds,
        "stages": stages,
        "newton": problem.num_iterations,
        "iterations": problem.num_linear_iterations,
        "most_iterations": max(counts.iterations),
        "augmentations": problem.num_augmentations,
        "gap": gap,
        "points": points,
        "force": abs(float(pair.force("slave")[2])),
    }


class Count:
    """Iterations of each linear solve."""

    def __init__(self, ksp):
        self.iterations = []
        ksp.setMonitor(self)

    def __call__(self, ksp, iteration, norm):
        if iteration == 0:
            self.iterations.append(0)
        else:
            self.iterations[-1] = iteration
