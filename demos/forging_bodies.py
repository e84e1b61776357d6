"""The bodies of the forging demo: workpiece and elastic dies, a quarter of each."""

import ufl
from dolfinx import fem

import qsdolfinx as qs

from common.bodies import facets_at, fix
from forming_bodies import NortonHoff, quarter_cylinder

RADIUS, HEIGHT = 10.0, 15.0  # of the workpiece, mm
K, M, SPEED = 50.0, 0.15, 10.0  # MPa sᵐ, -, mm/s
E_DIE, NU_DIE = 2.1e5, 0.3


class Die:
    """Elastic die, a quarter of a cylinder, in total displacements.

    Args:
        comm: Communicator.
        z: Height of the face.
        sign: 1: the die is above the face, -1: below it.
        h: Size of the cells on the face; they grow away from it.
        reach: Radius within which contact may occur.
        E: Young's modulus.
        nu: Poisson's ratio.
    """

    RADIUS, HEIGHT = 18.0, 9.0

    def __init__(self, comm, z, sign, h, reach, E, nu):
        beyond = f"(sqrt(x*x+y*y)-{reach})"
        size = f"{h}+0.35*(abs(z-{z})+0.5*({beyond}+abs({beyond})))"
        bottom = z if sign > 0 else z - self.HEIGHT
        self.mesh = msh = quarter_cylinder(comm, self.RADIUS, bottom, self.HEIGHT, size)
        self.V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        self.u = fem.Function(self.V)
        self.stress = qs.materials.linear_elastic(self.u, E, nu)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        #: Displacement of the back along z.
        self.height = fem.Constant(msh, 0.0)
        back = facets_at(msh, 2, z + sign * self.HEIGHT)
        self.bcs = [fix(self.V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
        self.bcs.append(fix(self.V, 2, back, self.height))
        self.surface = qs.Surface(self.V, facets=facets_at(msh, 2, z))


def create_bodies(comm, h, die_refinement):
    """Create the workpiece, with cells of size h, and the two dies."""
    msh = quarter_cylinder(comm, RADIUS, 0.0, HEIGHT, str(h))
    work = NortonHoff(msh, K, M, slow=1e-3 * SPEED / HEIGHT)
    work.bcs = [fix(work.W.sub(0), axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
    work.lower, work.upper = (work.surface(facets_at(msh, 2, z)) for z in (0.0, HEIGHT))
    fine = h / die_refinement
    dies = [Die(comm, z, s, fine, 1.2 * RADIUS, E_DIE, NU_DIE) for z, s in ((0.0, -1), (HEIGHT, 1))]
    return work, dies
