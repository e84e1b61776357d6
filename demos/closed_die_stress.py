"""Stress in a die of the closed-die demo: an elastic solid under the tractions of the billet.

The solid's face is finer than the billet. The tractions recovered at the nodes of the billet are
transferred to the nodes of the die by the transposed operator of the relative displacement,
integrated over the segments of their facets. The force is conserved to rounding wherever the billet
is above the die.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc as fem_petsc

import qsdolfinx as qs
from qsdolfinx.surface.traction import recover

from closed_die_tools import die_mesh, height, skin
from common.bodies import facets_at, fix
from common.drawing import cell_values

E, NU = 2.1e5, 0.3  # tool steel, MPa
THICKNESS = 25.0  # mm, distance from the land to the back


class ElasticDie:
    """The lower die as an elastic solid, held at its back and on the planes of symmetry.

    Args:
        comm: Communicator.
        size: Size of the cells on its face.
        coarse: Size of the cells at its back.
    """

    def __init__(self, comm, size, coarse=6.0):
        self.mesh = msh = die_mesh(comm, "lower", size, coarse, THICKNESS)
        self.V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        self.u = fem.Function(self.V, name="displacement")
        self.stress = qs.materials.linear_elastic(self.u, E, NU)
        back = facets_at(msh, 2, height("lower", THICKNESS))
        self.bcs = [fix(self.V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
        self.bcs.append(fix(self.V, 2, back))
        outer = np.concatenate([back, facets_outside(msh)])
        self.surface = qs.Surface(self.V, facets=np.setdiff1d(skin(msh), outer).astype(np.int32))
        #: Traction on the face, and the force after and before the transfer.
        self.traction, self.arrived, self.sent = None, np.zeros(3), np.zeros(3)

    def load(self, surface, traction, dt):
        """Solve for the tractions of the billet. Collective.

        Args:
            surface: Surface of the billet.
            traction: Traction on this surface, a Function.
            dt: Length of a step; needed because the billet is velocity-based.
        """
        unknown = "velocity", "displacement"
        pair = qs.Contact(surface, self.surface, unknown=unknown, dt=dt, constraints="nodes")
        gap = pair.model.gaps[0]
        operator = gap.jump_operator()
        forces = surface.node_values(traction) * surface.node_area[:, None]
        # The whole force of a node acts on the part of its area that is above the die.
        rows = forces[operator.row_node] / gap.cover_share[:, None]
        vecs = surface.create_vec(), self.surface.create_vec()
        operator.add_transpose(rows, vecs[0].handle, vecs[1].handle)
        force = vecs[1]
        comm = self.mesh.comm
        self.traction = recover(self.surface, force)
        self.arrived = comm.allreduce(force.array_r.reshape(-1, 3).sum(axis=0))
        self.sent = -comm.allreduce(forces.sum(axis=0))
        self.solve(force)
        for vec in vecs:
            vec.destroy()

    def solve(self, force):
        """Compute the displacement under nodal forces. Collective."""
        F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        form = fem.form(ufl.derivative(F, self.u))
        A = fem_petsc.assemble_matrix(form, bcs=self.bcs)
        A.assemble()
        b = force.copy()
        fem_petsc.set_bc(b, self.bcs)
        solver = PETSc.KSP().create(self.mesh.comm)
        solver.setOperators(A)
        solver.setType("preonly")
        solver.getPC().setType("lu")
        solver.getPC().setFactorSolverType("mumps")
        solver.solve(b, b)
        self.u.x.array[: len(b.array_r)] = b.array_r
        self.u.x.scatter_forward()
        for thing in (solver, A, b):
            thing.destroy()

    def von_mises(self):
        """Compute the von Mises stress in the cells, MPa."""
        s = ufl.dev(self.stress)
        return cell_values(self.mesh, ufl.sqrt(1.5 * ufl.inner(s, s)))

    def peaks(self):
        """Compute the largest traction on the face and the largest stress, MPa. Collective."""
        t = np.linalg.norm(self.surface.node_values(self.traction), axis=1)
        local = t.max(initial=0.0), self.von_mises().max(initial=0.0)
        return tuple(self.mesh.comm.allreduce(value, op=MPI.MAX) for value in local)


def facets_outside(msh):
    """Find the facets on the cylinder that bounds a quarter of a die."""
    radius = msh.comm.allreduce(msh.geometry.x[:, :2].max(), op=MPI.MAX)
    return mesh.locate_entities_boundary(
        msh, 2, lambda x: np.hypot(x[0], x[1]) > (1 - 1e-3) * radius
    )
