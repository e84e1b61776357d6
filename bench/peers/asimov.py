"""Run a job through dolfinx_contact (asimov-contact): unbiased Nitsche method, on one rank.

scripts/with-dolfinx env PYTHONPATH=FOLDER/asimov/python python3 bench/peers/asimov.py --sizes 22,18
"""

import argparse
import pathlib
import sys

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_contact.helpers
import numpy as np
from dolfinx_contact.cpp import ContactMode
from dolfinx_contact.general_contact.contact_problem import ContactProblem, FrictionLaw

import dolfinx
import ufl
from dolfinx import fem, graph, mesh
from dolfinx.fem import petsc

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import dolfinx_mesh
import jobs
import sphere

COMM = MPI.COMM_WORLD
#: Krylov method: the relative residual is the same as for the other programs.
CG = {"ksp_type": "cg", "ksp_rtol": 1e-8, "ksp_norm_type": "unpreconditioned"}
#: Solver of its demos (PETSc 3.22 has no pc_gamg_square_graph any more), other fast solvers, and a
#: direct solver.
SOLVERS = {
    "gamg": CG
    | {
        "pc_type": "gamg",
        "matptap_via": "scalable",
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "jacobi",
        "pc_gamg_agg_nsmooths": 1,
        "pc_gamg_coarse_eq_limit": 1000,
        "pc_gamg_threshold": 0.015,
        "pc_gamg_reuse_interpolation": True,
    },
    "boomeramg": CG
    | {
        "pc_type": "hypre",
        "pc_hypre_boomeramg_strong_threshold": 0.7,
        "pc_hypre_boomeramg_coarsen_type": "HMIS",
        "pc_hypre_boomeramg_interp_type": "ext+i",
        "pc_hypre_boomeramg_P_max": 4,
    },
    "icc": CG | {"pc_type": "icc"},
    "mumps": {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"},
}


def near(job, body, quads):
    """Return the faces that may come into contact; for the job "hertz" those of even cells.

    On open faces Nitsche's method subtracts the normal stress from the energy. Outside the contact
    zone cells are long and flat, and with a parameter that is large enough elsewhere the matrix is
    indefinite there.
    """
    if job is not sphere:
        return quads
    return quads[body.x[quads, :2].max(axis=2).min(axis=1) < sphere.EVEN[0][0]]


class Job:
    """Both bodies in one mesh, with the elastic forms and the conditions."""

    def __init__(self, job, sizes):
        lower, upper = job.bodies(sizes)
        first = len(lower.x)
        self.mesh = dolfinx_mesh.create_mesh(
            COMM,
            np.concatenate([lower.x, upper.x]),
            np.concatenate([lower.cells, upper.cells + first]),
        )
        is_upper = self.mesh.topology.original_cell_index >= len(lower.cells)
        self.cells = mesh.meshtags(
            self.mesh, 3, np.arange(len(is_upper), dtype=np.int32), is_upper.astype(np.int32)
        )
        V0 = fem.functionspace(self.mesh, ("DG", 0))
        self.mu, self.lame = fem.Function(V0), fem.Function(V0)
        modulus = np.array(job.E)[is_upper.astype(int)]
        self.mu.x.array[:] = modulus / (2 * (1 + job.NU))
        self.lame.x.array[:] = modulus * job.NU / ((1 + job.NU) * (1 - 2 * job.NU))
        self.V = V = fem.functionspace(self.mesh, ("Lagrange", 1, (3,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        strain = ufl.sym(ufl.grad(self.u))
        stress = self.lame * ufl.tr(strain) * ufl.Identity(3) + 2 * self.mu * strain
        # Eight points in each cell, as in the other programs: exact for boxes.
        form = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=3)
        self.residual = fem.form(form)
        self.jacobian = fem.form(ufl.derivative(form, self.u))
        self.held = self.dofs(V, lower.low)
        self.bcs = [
            fem.dirichletbc(np.zeros(3), self.held, V),
            fem.dirichletbc(np.array([0, 0, job.PRESS]), self.dofs(V, upper.high + first), V),
        ]
        for body, shift in ((lower, 0), (upper, first)):
            for axis, quads in body.planes.items():
                W = V.sub(axis)
                self.bcs.append(fem.dirichletbc(0.0, self.dofs(W, quads + shift), W))
        self.fixed = np.unique(np.concatenate([bc.dof_indices()[0] for bc in self.bcs]))
        touching = [
            dolfinx_mesh.locate(self.mesh, quads)
            for quads in (near(job, lower, lower.high), near(job, upper, upper.low) + first)
        ]
        self.touching = self.tag(touching)
        # The upper body is moved as a whole, so that contact is closed, as in the program's Hertz
        # demo.
        blocks = np.unique(V.dofmap.list[is_upper])
        self.u.x.array.reshape(-1, 3)[blocks, 2] = job.PRESS

    def dofs(self, W, quads):
        """Return the degrees of freedom on a side of a body."""
        return fem.locate_dofs_topological(W, 2, dolfinx_mesh.locate(self.mesh, quads))

    def tag(self, sides):
        """Tag the facets of both sides with 1 and 2."""
        facets = np.concatenate(sides)
        tags = np.repeat(np.array([1, 2], dtype=np.int32), [len(side) for side in sides])
        order = np.argsort(facets)
        return mesh.meshtags(self.mesh, 2, facets[order], tags[order])


class Contact:
    """Unbiased Nitsche contact of a job: residual and Jacobian for the program's Newton solver."""

    def __init__(self, job, gamma, theta, order, search):
        self.job, self.gamma, self.theta = job, gamma, theta
        surfaces = graph.adjacencylist(np.array([1, 2], np.int32), np.array([0, 2], np.int32))
        mode = {"closest": ContactMode.ClosestPoint, "rays": ContactMode.Raytracing}[search]
        pairs = [(0, 1), (1, 0)]
        job.mesh.topology.create_connectivity(3, 3)
        self.problem = ContactProblem(
            [job.touching], surfaces, pairs, job.mesh, order, [mode, mode]
        )
        given = {"u": fem.Function(job.V), "du": job.u, "mu": job.mu, "lambda": job.lame}
        self.problem.generate_contact_data(FrictionLaw.Frictionless, job.V, given, gamma, theta)

    def coefficients(self, x, _):
        """Return values at the quadrature points."""
        self.problem.update_contact_data(self.job.u)

    def residual(self, x, b, _):
        """Assemble elastic and contact forces, with the conditions."""
        job = self.job
        b.zeroEntries()
        self.problem.assemble_vector(b, job.V)
        petsc.assemble_vector(b, job.residual)
        # No lifting: the displacements satisfy the conditions from the start.
        petsc.set_bc(b, job.bcs, x, -1.0)

    def jacobian(self, x, A, _):
        """Assemble the Jacobian."""
        job = self.job
        A.zeroEntries()
        self.problem.assemble_matrix(A, job.V)
        petsc.assemble_matrix(A, job.jacobian, bcs=job.bcs)
        A.assemble()
        # The contact code does not know conditions, and symmetry planes end in the contact surface.
        A.zeroRowsColumnsLocal(job.fixed)

    def forces(self, theta):
        """Return the contact force at each degree of freedom; with theta = 0, only of tractions."""
        b = petsc.create_vector(self.job.residual)
        self.problem.update_nitsche_parameters(self.gamma, theta)
        self.problem.assemble_vector(b, self.job.V)
        self.problem.update_nitsche_parameters(self.gamma, self.theta)
        return -b.array


def create_solver(p, job, contact):
    """Make the program's Newton solver; its stopping residual is relative to the first one."""
    A = contact.problem.create_matrix(job.jacobian)
    bodies = np.array([0, 1], dtype=np.int32)
    rigid = dolfinx_contact.helpers.rigid_motions_nullspace_subdomains
    A.setNearNullSpace(rigid(job.V, job.cells, bodies, num_domains=2))
    b = petsc.create_vector(job.residual)
    newton = dolfinx_contact.NewtonSolver(COMM, A, b, contact.problem.coeffs)
    newton.set_coefficients(contact.coefficients)
    newton.set_residual(contact.residual)
    newton.set_jacobian(contact.jacobian)
    contact.residual(job.u.x.petsc_vec, b, None)
    # Its relative criterion refers to the norm of the first step: set as an absolute criterion.
    options = {"rtol": np.inf, "atol": p.rtol * b.norm(), "max_it": 50}
    newton.set_newton_options(options | {"error_on_nonconvergence": True})
    newton.set_krylov_options(SOLVERS[p.linear])
    return newton


def solve(p):
    """Return displacements, contact forces (arguments of ``hertz_error.measure``) and row."""
    job = Job(p.job, p.sizes)
    contact = Contact(
        job, p.gamma * max(p.job.E), formulation=p.theta, law=p.order, penalty=p.search
    )
    newton = create_solver(p, job, contact)
    iterations, _ = newton.solve(job.u)
    nodes = job.mesh.geometry.dofmap
    elastic = petsc.assemble_vector(job.residual).array.reshape(-1, 3)
    u, loads, tractions = (
        dolfinx_mesh.at_nodes(values, job.V, nodes)
        for values in (job.u.x.array, contact.forces(p.theta), contact.forces(0.0))
    )
    row = {
        "force": float(abs(elastic[job.held, 2].sum())),
        "newton": iterations,
        "krylov": newton.krylov_iterations,
    }
    return u, {"loads": loads, "tractions": tractions}, row


def arguments():
    """Parse the arguments of the driver."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    jobs.add_arguments(parser)
    add("--linear", choices=tuple(SOLVERS), default="gamg")
    add("--gamma", type=float, default=10.0, help="Nitsche's parameter over the larger E")
    add("--theta", type=float, choices=(1.0, 0.0, -1.0), default=1.0)
    add("--order", type=int, default=5, help="quadrature degree of the contact")
    add("--search", choices=("closest", "rays"), default="closest")
    add("--rtol", type=float, default=1e-6, help="tolerance of Newton's method")
    return parser


def main():
    p = jobs.parse(arguments())
    u, contact, row = solve(p)
    numbers = ".".join(map(str, PETSc.Sys.getVersion()))
    row["version"] = f"with DOLFINx {dolfinx.__version__} and PETSc {numbers}"
    if row["krylov"] == row["newton"]:  # a direct solver
        del row["krylov"]
    jobs.report(p.output, u, contact, **row)


if __name__ == "__main__":
    main()
