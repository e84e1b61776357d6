"""Two elasto-plastic half-rings are pushed past each other.

D. Neto, M. Oliveira, L. Menezes, J. Alves, *Computer Methods in Applied Mechanics and Engineering*
299 (2016) 283-315: radii 10 and 12 mm below, 8 and 10 mm above, pushed by 31.5 mm; plane strain, 1
mm thick, E = 689.56 MPa, ν = 0.32, σ_Y = 31 MPa, H = 261.2 MPa. The paper was not available. These
data, and the paper's curves of the force on the ends of the lower ring, digitised to about 1 % of
their largest force, are from the solids4foam tutorial `curvedBeams`. The largest F_x and F_y of
solids4foam for μ = 0.3, on its finest mesh, are 16.97 and 38.87 N.

Our model: finite sliding, 63 steps, quadrilaterals of degree 1 with a constant pressure in each, 3
× 40 and 3 × 36, `qs.J2Plasticity` (Hencky elasticity; solids4foam uses a neo-Hookean material). The
penalty is 300 MPa/mm: with an augmented Lagrangian, or with displacements of degree 2, Newton's
method did not reach the end in the runs that were tried. F_x changes its sign after the top. The
small run is the run without friction, until F_x is largest.
"""

import numpy as np
from common.bodies import facets_at
from verified_cases.row import Row

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

TITLE = "Curved beams (Neto et al. 2016)"
FAR = 0.02

E, NU, YIELD, HARDENING = 689.5564786, 0.32, 31.0, 261.2  # MPa
LOWER, UPPER, HEIGHT, WAY = (10.0, 12.0), (8.0, 10.0), 17.0, 31.5  # mm
#: x of the upper centre at which the rings just touch.
START = -np.sqrt((LOWER[1] + UPPER[1]) ** 2 - HEIGHT**2)
STEPS, PENALTY = 63, 300.0
#: Extremes of the published curves, N: F_x before and after the top, F_y; None where there is none.
PUBLISHED = {
    0.0: (-9.539, 7.458, 35.66),
    0.3: (-17.280, 3.824, 39.005),
    0.6: (-27.734, None, 45.628),
}
DIGITISED = 0.01  # of a curve's largest force


def create_half_ring(comm, n, radii, centre, side):
    """Create a mesh of a half-ring with n[0] quadrilaterals across and n[1] around.

    Args:
        comm: Communicator.
        n: Numbers of cells.
        radii: Inner and outer radius.
        centre: Centre of the circles.
        side: 1: the arch is above its centre; −1: below.
    """
    x, cells = np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64)
    if comm.rank == 0:
        r, angle = np.linspace(*radii, n[0] + 1), np.linspace(0, np.pi, n[1] + 1)[:, None]
        ring = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)
        x = np.array(centre) + side * ring.reshape(-1, 2)
        node = np.arange(len(x)).reshape(n[1] + 1, n[0] + 1)
        corners = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
        cells = np.stack(corners, axis=-1).reshape(-1, 4)
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=x, e=ufl.Mesh(element))


class Beam:
    """An elasto-plastic half-ring with contact on its outside; arguments as above."""

    def __init__(self, comm, n, radii, centre, side):
        msh = create_half_ring(comm, n, radii, centre, side)
        displacement = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        pressure = basix.ufl.element("DG", "quadrilateral", 0)
        W = fem.functionspace(msh, basix.ufl.mixed_element([displacement, pressure]))
        V, self.w = W.sub(0), fem.Function(W)
        self.body = qs.J2Plasticity(self.w, E, NU, YIELD, HARDENING, degree=3)
        self.F, self._residual = self.body.residual, fem.form(self.body.residual)
        outside = mesh.locate_entities_boundary(
            msh, 1, lambda x: np.isclose(np.hypot(x[0] - centre[0], x[1] - centre[1]), radii[1])
        )
        self.surface = qs.Surface(V, facets=outside)
        ends, parts = facets_at(msh, 1, centre[1]), [V.sub(0), V.sub(1)]
        self._ends = [fem.locate_dofs_topological(part, 1, ends) for part in parts]
        #: Displacement of the ends along x.
        self.shift = fem.Constant(msh, 0.0)
        values = zip((self.shift, 0.0), self._ends, parts, strict=True)
        self.bcs = [fem.dirichletbc(value, dofs, part) for value, dofs, part in values]

    def reaction(self):
        """Return the reaction force at the ends. Collective."""
        b = fem.assemble_vector(self._residual)
        b.scatter_reverse(la.InsertMode.add)
        own = b.index_map.size_local * b.block_size
        here = np.array([b.array[dofs[dofs < own]].sum() for dofs in self._ends])
        return self.w.function_space.mesh.comm.allreduce(here)


def push(comm, n, mu, way=WAY):
    """Push the upper ring; return the forces on the ends of the lower ring, shape (steps, 2)."""
    lower = Beam(comm, n, LOWER, (0.0, 0.0), 1)
    upper = Beam(comm, (n[0], round(0.9 * n[1])), UPPER, (START, HEIGHT), -1)
    contact = qs.Contact(
        upper.surface,
        lower.surface,
        sliding="finite",
        enforcement="penalty",
        penalty=PENALTY,
        friction=qs.Coulomb(mu) if mu else None,
    )
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.w, lower.w], [contact], [upper.bcs, lower.bcs]
    )

    def drive(t, dt):
        upper.shift.value = t

    step = WAY / STEPS
    stepper, forces = qs.TimeStepper(problem, step, drive, dt_max=step), []
    for _ in stepper.run(way):
        for beam in (lower, upper):
            beam.body.update()
        forces.append(lower.reaction())
    problem.destroy()
    return np.array(forces)


def run(small, comm):
    """Push with each coefficient of friction; small: without friction, until F_x is largest."""
    rows, n = [], (3, 40)
    for mu, published in PUBLISHED.items():
        if small and mu > 0:
            break
        fx, fy = push(comm, n, mu, 9.0 if small else WAY).T
        largest = np.abs([published[0], published[0], published[2]])  # of the same curve
        for name, reference, ours, most in zip(
            ("F_x before the top", "F_x after it", "F_y"),
            published[:1] if small else published,
            (fx.min(), fx.max(), fy.max()),
            largest,
            strict=False,
        ):
            if reference is not None:
                scatter = DIGITISED * most / abs(reference)
                quantity = f"largest {name}, N, μ = {mu:g}"
                rows.append(Row(quantity, reference, ours, scatter, "Neto et al. 2016"))
    return rows
