"""Bodies of the patch test (patch_test.py): meshes, materials, conditions and stresses."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import measure
from common.measures import mean_and_max

E_MASTER, E_SLAVE = 3e4, 1.3e4  # Young's moduli of the elastic cubes
VISCOSITY = 200.0  # viscosity of both Newtonian cubes, stress × time
STRESS = -65.0  # exact normal stress on planes that are horizontal before rotation


class Elastic:
    """Linear elastic material without lateral strain, ν = 0.

    Args:
        E: Young's modulus.
    """

    unknown, dt, gap_tolerance = "displacement", None, 1e-13

    def __init__(self, E):
        self.E = E

    def spaces(self, body):
        """Space of the unknown, and that of the displacement in it."""
        V = fem.functionspace(body, ("Lagrange", 1, (body.geometry.dim,)))
        return V, V

    def strain(self, gdim):
        """Strain of the exact solution along the axes."""
        return np.array([0.0] * (gdim - 1) + [STRESS / self.E])

    def forms(self, u):
        """Stress, residual without loads, and test function of the displacement."""
        v = ufl.TestFunction(u.function_space)
        stress = self.E * ufl.sym(ufl.grad(u))
        return stress, ufl.inner(stress, ufl.grad(v)) * ufl.dx, v


class Newtonian:
    """Incompressible Newtonian fluid, with velocities and pressure.

    Args:
        K: Viscosity.
    """

    unknown, dt, gap_tolerance = "velocity", 1.0, 1e-12

    def __init__(self, K):
        self.K = K

    def spaces(self, body):
        """Space of the unknown, and that of the velocity in it."""
        W = qs.materials.mini_space(body)
        return W, W.sub(0)

    def strain(self, gdim):
        """Strain rate of the exact solution along the axes; plane strain in 2D."""
        rate = STRESS / ((3 if gdim == 3 else 4) * self.K)
        return np.array([-rate / (gdim - 1)] * (gdim - 1) + [rate])

    def forms(self, w):
        """Stress, residual without loads, and test function of the velocity."""
        v, p = ufl.split(w)
        deviator = qs.materials.newtonian(v, self.K)
        stress = deviator - p * ufl.Identity(len(v))
        return (
            stress,
            qs.materials.incompressible(w, deviator),
            ufl.TestFunctions(w.function_space)[0],
        )


MATERIALS = {  # of the master and the slave
    "elastic": (Elastic(E_MASTER), Elastic(E_SLAVE)),
    "newtonian": (Newtonian(VISCOSITY), Newtonian(VISCOSITY)),
}


def check(material, cell, overhang):
    """Refuse parameters that the test does not support.

    Raises:
        ValueError: For an unsupported parameter, with the option and the reason.
    """
    if material not in MATERIALS:
        raise ValueError(f"--material: must be one of {', '.join(MATERIALS)}")
    if material == "newtonian" and cell not in ("tetrahedron", "triangle"):
        raise ValueError(
            "--cell: Newtonian cubes are of the MINI element, which needs tetrahedron or triangle "
            f"cells, not {cell}"
        )
    if material == "newtonian" and overhang:
        raise ValueError(
            "--overhang: Newtonian cubes have no uniform flow to compare with where one of them is "
            "not supported; use it with --material elastic"
        )


def create_block(comm, n, cell, low, high, jitter, rng):
    """Create a block on the unit square with n × n cells in layers of height 1.

    The nodes at height 1, inside the block or on its end, are moved in their plane.

    Args:
        comm: Communicator.
        n: Cells along each edge of the interface.
        cell: Cell type.
        low: Height of the bottom.
        high: Height of the top.
        jitter: Largest displacement of a node from its regular position, in units of the cell size.
        rng: Random generator, in the same state on all ranks.
    """
    kind = mesh.CellType[cell]
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    corners = [[0.0] * (gdim - 1) + [low], [1.0] * (gdim - 1) + [high]]
    create = mesh.create_rectangle if gdim == 2 else mesh.create_box
    block = create(comm, corners, [n] * (gdim - 1) + [round(high - low)], kind)

    # One shift per lattice point, independent of the ranks that have the node.
    length = jitter / n * np.sqrt(rng.random((n + 1, n + 1)))
    angle = 2 * np.pi * rng.random((n + 1, n + 1))
    x = block.geometry.x
    i, j = (np.rint(n * x[:, d]).astype(int) for d in (0, 1 if gdim == 3 else 2))
    inner = np.isclose(x[:, gdim - 1], 1) & (i > 0) & (i < n)
    if gdim == 3:
        inner &= (j > 0) & (j < n)
        x[inner, 1] += (length * np.sin(angle))[i[inner], j[inner]]
    x[inner, 0] += (length * np.cos(angle))[i[inner], j[inner]]
    return block


def rotation(degrees, gdim):
    """Return the rotation matrix for an angle, in 3D about the axis (1, 1, 0)."""
    angle = np.deg2rad(degrees)
    if gdim == 2:
        plane = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.block([[plane, np.zeros((2, 1))], [np.zeros((1, 2)), np.ones((1, 1))]])
    across = np.array([[0, 0, 1], [0, 0, -1], [-1, 1, 0]]) / np.sqrt(2)  # x ↦ axis × x
    return np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across


class Body:
    """A block with its conditions; unknowns are displacements, or velocities and pressure.

    Args:
        block: Mesh in its position before the rotation.
        material: Its material.
        low: Height of the bottom.
        high: Height of the top.
        left: Smallest x of the block.
        rotate: Rotation angle in degrees.
    """

    def __init__(self, block, material, low, high, left=0.0, rotate=0.0):
        self.mesh, self.material, self.high = block, material, high
        self.gdim = gdim = block.geometry.dim
        self.up = up = gdim - 1

        def at(dim, *places):
            def marker(x):
                return np.all([np.isclose(x[axis], value) for axis, value in places], axis=0)

            block.topology.create_connectivity(dim, gdim)
            return mesh.locate_entities(block, dim, marker)

        sides = [(axis, left if axis == 0 else 0.0) for axis in range(up)]
        self.sides = [(axis, at(up, (axis, value))) for axis, value in sides]
        self.bottom, self.interface, self.top = (at(up, (up, z)) for z in (low, 1.0, high))
        edge = [(up, high), *sides[1:]]
        self.corners = np.concatenate([at(0, (0, left + x), *edge) for x in (0, 1)])

        turn = rotation(rotate, gdim)
        block.geometry.x[:] = block.geometry.x @ turn.T
        self.turn = turn[:gdim, :gdim]
        self.normal = self.turn[:, up]

        W, self.V = material.spaces(block)
        self.u = fem.Function(W)
        self.stress, self.F, self.test = material.forms(self.u)
        #: Displacement or velocity with the loads of the test; set when ε is known.
        self.exact = fem.Function(self.V if self.V is W else self.V.collapse()[0])
        #: Its normal component at the top.
        self.lid = fem.Constant(block, 0.0)
        #: Whether only the tie holds the edges of the interface, see ``set_conditions``.
        self.tied_edges = False
        self.bcs = []

    def set_exact(self, offset):
        """Set the uniform solution, given its value at height 0 (also outside the body)."""
        strain = self.material.strain(self.gdim)
        gradient = self.turn @ np.diag(strain) @ self.turn.T

        def u(x):
            return gradient @ x[: self.gdim] + offset * self.normal[:, None]

        self.exact.interpolate(u)
        self.lid.value = offset + strain[self.up] * self.high

    def slide(self, axis, facets, value=0.0, but=()):
        """Prescribe the unknown along an axis, on facets except where they meet others."""
        V = self.V.sub(axis)
        on, off = (
            fem.locate_dofs_topological(V, self.up, np.asarray(f, dtype=np.int32))
            for f in (facets, but)
        )
        return fem.dirichletbc(value, np.setdiff1d(on, off), V)

    def prescribe(self, dim, entities):
        """Prescribe the exact displacement or velocity."""
        if self.exact.function_space is self.V:
            return fem.dirichletbc(self.exact, fem.locate_dofs_topological(self.V, dim, entities))
        spaces = (self.V, self.exact.function_space)
        dofs = fem.locate_dofs_topological(spaces, dim, entities)
        return fem.dirichletbc(self.exact, dofs, self.V)

    def press(self):
        """Pressure on the top."""
        normal = ufl.as_vector(self.normal)
        self.F -= STRESS * ufl.dot(normal, self.test) * measure(self.mesh, self.top)

    def interface_stress(self):
        """Compute the mean normal stress of each owned cell with a facet at height 1."""
        n = ufl.as_vector(self.normal)
        q = ufl.TestFunction(fem.functionspace(self.mesh, ("DG", 0)))
        force = fem.assemble_vector(fem.form(ufl.dot(n, self.stress * n) * q * ufl.dx)).array
        volume = fem.assemble_vector(fem.form(q * ufl.dx)).array
        to_cell = self.mesh.topology.connectivity(self.up, self.gdim)
        cells = {cell for facet in self.interface for cell in to_cell.links(facet)}
        owned = self.mesh.topology.index_map(self.gdim).size_local
        cells = np.array(sorted(cell for cell in cells if cell < owned), dtype=int)
        return force[cells] / volume[cells]  # DG0 unknowns are numbered as cells


def create_cubes(comm, p):
    """Create the master below and the slave above, with the cells, position and material given.

    Args:
        comm: Communicator.
        p: Parameters of the patch test.
    """
    rng = np.random.default_rng(p.seed)
    lower = create_block(comm, p.master, p.cell, 0.0, 1.0, p.jitter, rng)
    upper = create_block(comm, p.slave, p.cell, 1.0, 2.0, p.jitter, rng)
    upper.geometry.x[:, 0] += p.overhang
    of_master, of_slave = MATERIALS[p.material]
    master = Body(lower, of_master, 0.0, 1.0, 0.0, p.rotate)
    return master, Body(upper, of_slave, 1.0, 2.0, p.overhang, p.rotate)


def set_conditions(bodies, load, rotate):
    """Set conditions and load of a stack of bodies, the lowest first."""
    lower, upper = bodies[0], bodies[-1]
    if load == "pressure":
        upper.press()
    if rotate == 0:
        lower.bcs.append(lower.slide(lower.up, lower.bottom))
        for body in bodies:
            # A multiplier at a slave node with a condition acts only on neighbouring nodes. With a
            # stiff penalty, when fluids would flow sideways between nodes, such multipliers are
            # larger than the pressure. Therefore the tie holds these nodes, to a held master.
            but = body.interface if body.tied_edges else ()
            body.bcs += [body.slide(*side, but=but) for side in body.sides]
        if load == "displacement":
            upper.bcs.append(upper.slide(upper.up, upper.top, upper.lid))
        return
    # DOLFINx has no conditions along one rotated axis. Prescribe the exact solution, where it holds
    # the bodies and does not disturb the uniform stress.
    lower.bcs.append(lower.prescribe(lower.up, lower.bottom))
    held = (upper.up, upper.top) if load == "displacement" else (0, upper.corners)
    upper.bcs.append(upper.prescribe(*held))


def set_exact(master, slave, gap):
    """Set the uniform solution in both cubes; the upper cube also moves by the given gap."""
    up, gdim = slave.up, slave.gdim
    strain = master.material.strain(gdim)[up] - slave.material.strain(gdim)[up]
    master.set_exact(0.0)
    slave.set_exact(strain + gap)


def reference_stress(comm, p):
    """Return the mean stress at the interface: analytical for elastic cubes, else of a single body.

    The single body is the union of the two cubes, on the mesh of the master, under the same load.
    """
    if p.material == "elastic":
        return STRESS
    rng = np.random.default_rng(p.seed)  # same seed as the master: the same nodes at height 1
    union = create_block(comm, p.master, p.cell, 0.0, 2.0, p.jitter, rng)
    body = Body(union, MATERIALS[p.material][0], 0.0, 2.0, 0.0, p.rotate)
    set_conditions((body,), p.load, p.rotate)
    body.set_exact(0.0)
    problem = qs.ContactProblem([body.F], [body.u], [], [body.bcs])
    problem.solve()
    problem.destroy()
    return mean_and_max(comm, body.interface_stress())[0]
