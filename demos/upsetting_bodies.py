"""Bodies of the upsetting test, and errors of two tied bodies against a single body."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import fix, integral

E, NU, DELTA = 1.0, 0.3, 0.01


def stress(u):
    """Return the stress in plane strain."""
    return qs.materials.linear_elastic(u, E, NU)


def locate(msh, axis, value):
    """Find facets, on the boundary or inside, in a plane normal to an axis."""
    return mesh.locate_entities(msh, 1, lambda x: np.abs(x[axis] - value) < 1e-12)


def create_mesh(comm, n, lower, upper, grading):
    """Create a graded mesh between heights lower and upper (−1, 0 or 1), n cells wide."""
    # Errors need the cells on both sides of facets that ranks share.
    ghosts = {"ghost_mode": mesh.GhostMode.shared_facet}
    corners, cells = [[0.0, lower], [1.0, upper]], [n, n * (upper - lower)]
    msh = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral, **ghosts)
    # Common coordinates of different meshes are bitwise equal.
    t = np.rint(n * msh.geometry.x[:, :2]) / n
    msh.geometry.x[:, :2] = np.sign(t) * (1 - (1 - np.abs(t)) ** grading)
    msh.topology.create_connectivity(1, 2)
    return msh


class Body:
    """Elastic body with the conditions of symmetry and of the dies it reaches."""

    def __init__(self, msh, degree=1):
        self.mesh = msh
        self.V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u = fem.Function(self.V)
        self.F = ufl.inner(stress(self.u), ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        bottom, top = locate(msh, 1, -1.0), locate(msh, 1, 1.0)
        self.bcs = [fix(self.V, axis, bottom) for axis in (0, 1)]
        self.bcs += [fix(self.V, 0, top), fix(self.V, 1, top, -DELTA)]
        self.bcs.append(fix(self.V, 0, locate(msh, 0, 0.0)))

    def solve(self):
        """Solve for this body alone."""
        qs.ContactProblem([self.F], [self.u], [], [self.bcs]).solve()
        return self.u


class Reference:
    """Single-body solution on a mesh that contains all others, and errors against it.

    Q1 functions of a coarser mesh are Q1 on this mesh too, except for jumps across the interface.
    Therefore each block has its own function, which is used in the cells of this block only.

    Args:
        comm: Communicator.
        n: Cells along the interface, a multiple of those of all other meshes.
        grading: Grading of the mesh.
    """

    def __init__(self, comm, n, grading):
        self.mesh = msh = create_mesh(comm, n, -1, 1, grading)
        u, v = (Body(msh, degree).solve() for degree in (3, 2))
        self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.w, self.t = fem.Function(self.V), fem.Function(self.V)
        index_map = msh.topology.index_map(2)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        above = (mesh.compute_midpoints(msh, 2, cells)[:, 1] > 0).astype(np.int32)
        self.cells = {"master": cells[above == 0], "slave": cells[above == 1]}
        dx = ufl.Measure("dx", domain=msh, subdomain_data=mesh.meshtags(msh, 2, cells, above))
        facets = np.sort(locate(msh, 1, 0.0))
        tags = mesh.meshtags(msh, 1, facets, np.ones_like(facets))
        dS = ufl.Measure("dS", domain=msh, subdomain_data=tags)(1)

        def energy(w, measure):
            return fem.form(ufl.inner(stress(w), ufl.grad(w)) * measure)

        pressure = ufl.avg(stress(u)[1, 1])  # traction on the master; on the slave its negative
        self.energy_forms, self.traction_forms = {}, {}
        for tag, (side, sign) in enumerate((("master", 1), ("slave", -1))):
            self.energy_forms[side] = energy(self.w - u, dx(tag))
            self.traction_forms[side] = fem.form((self.t("+")[1] - sign * pressure) ** 2 * dS)
        self.energy = integral(msh, energy(u, ufl.dx))
        self.traction = integral(msh, pressure**2 * dS)
        #: Difference of quadratic and cubic elements: a bound for the error of the reference.
        self.error = np.sqrt(integral(msh, energy(u - v, ufl.dx)) / self.energy)
        self._places = {}

    def energy_error(self, u, sides):
        """Compute the squared energy norm of the error on some sides over the whole energy."""
        error = 0.0
        for side in sides:
            self.w.interpolate_nonmatching(u, self.cells[side], self.transfer(u, side))
            error += integral(self.mesh, self.energy_forms[side])
        return error / self.energy

    def traction_error(self, traction, side):
        """Compute the relative L2 norm of the error of the normal traction on the interface."""
        self.t.interpolate_nonmatching(traction, self.cells[side], self.transfer(traction, side))
        return np.sqrt(integral(self.mesh, self.traction_forms[side]) / self.traction)

    def transfer(self, u, side):
        """Find the points of the cells on one side in the mesh of u; computed once per mesh."""
        key = u.function_space.mesh, side
        if key not in self._places:
            self._places[key] = fem.create_interpolation_data(
                self.V, u.function_space, self.cells[side], padding=1e-9
            )
        return self._places[key]
