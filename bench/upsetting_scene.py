"""The billet of bench/upsetting_j2.py: its upper half, in any shape during upsetting."""

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.steps.mesh_motion import MeshMotion

RADIUS, HEIGHT = 10.0, 15.0  # mm
E, NU, YIELD, HARDENING = 200e3, 0.3, 700.0, 300.0  # MPa
ELEMENTS = ("mini", "taylor-hood")


def create_mesh(comm, cells):
    """Make the first mesh, with a number of squares of four triangles along the radius."""
    corners, count = [[0, 0], [RADIUS, HEIGHT]], [cells, round(cells * HEIGHT / RADIUS)]
    return mesh.create_rectangle(comm, corners, count, diagonal=mesh.DiagonalType.crossed)


def space(msh, element):
    """Make the space of displacement and pressure."""
    if element == "mini":
        return qs.materials.mini_space(msh)
    cell = msh.basix_cell()
    P2 = basix.ufl.element("Lagrange", cell, 2, shape=(2,))
    P1 = basix.ufl.element("Lagrange", cell, 1)
    return fem.functionspace(msh, basix.ufl.mixed_element([P2, P1]))


class Billet:
    """Body, contact and problem on a mesh.

    Args:
        msh: Mesh in (r, z), z = 0 at half height.
        die: Plane that moves down.
        element: One of ELEMENTS.
    """

    def __init__(self, msh, die, element="mini"):
        self.mesh, self.die = msh, die
        self.w = fem.Function(space(msh, element))
        V = self.w.function_space.sub(0)
        self.body = qs.J2Plasticity(self.w, E, NU, YIELD, HARDENING, axisymmetric=True)
        msh.topology.create_connectivity(1, 2)
        planes = [
            mesh.locate_entities_boundary(msh, 1, lambda x, k=k: np.abs(x[k]) < 1e-9)
            for k in (0, 1)
        ]
        self.free = np.setdiff1d(mesh.exterior_facet_indices(msh.topology), np.hstack(planes))
        # Gaps of nodes from a plane are exact, and a side that folds onto it is detected
        # immediately.
        self.contact = qs.Contact(
            qs.Surface(V, facets=self.free, axisymmetric=True),
            die,
            friction=qs.Sticking(),
            quadrature="nodal" if element == "mini" else "overlay",
        )
        bcs = [_fix(V, axis, facets) for axis, facets in enumerate(planes)]
        self.problem = qs.ContactProblem([self.body.residual], [self.w], [self.contact], [bcs])
        self._motion = MeshMotion(self.w)
        F = ufl.Identity(3) + qs.materials.gradient(ufl.split(self.w)[0], axisymmetric=True)
        volume = qs.materials.axisymmetric_weight(msh) * ufl.det(F) * self.body.dx
        self._volume = fem.form(volume)

    def force(self):
        """Return the force on the die. Collective."""
        return -self.contact.force("slave")[1]

    def volume(self):
        """Return the volume of the deformed half billet. Collective."""
        return self._total(self._volume)

    def energies(self):
        """Return the energy stored, and dissipated. Collective."""
        return [self.body.stored_energy(), self.body.dissipated_energy()]

    def radii(self, height):
        """Return radii at half height and at the end of contact with the die. Collective."""
        x = self.mesh.geometry.x + self._motion.values()
        nodes = np.unique(mesh.entities_to_geometry(self.mesh, 1, self.free))
        r, z = x[nodes, 0], x[nodes, 1]
        parts = [np.abs(z) < 1e-6, np.abs(z - height) < 5e-3 * RADIUS]
        found = [np.max(r[part], initial=0.0) for part in parts]
        return [max(radii) for radii in zip(*self.mesh.comm.allgather(found), strict=True)]

    def displacement(self):
        """Return the displacement as a separate function."""
        return self.w.sub(0).collapse()

    def carry_from(self, old):
        """Transfer the state from another mesh in its deformed configuration. Collective."""
        options = {"displacement": old.displacement(), "axisymmetric": True}
        for name, field in self.body.fields.items():
            found = qs.transfer(old.body.fields[name], field.function_space, **options)
            field.x.array[:] = found.x.array
        self.body.restart()

    def _total(self, form):
        return self.mesh.comm.allreduce(fem.assemble_scalar(form))


def _fix(V, axis, facets):
    dofs = fem.locate_dofs_topological(V.sub(axis), 1, facets)
    return fem.dirichletbc(0.0, dofs, V.sub(axis))
