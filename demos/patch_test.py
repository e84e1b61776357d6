"""Contact patch test of Fourment & Popa (2005), Table 1, cases 1 and 2: two elastic cubes.

Two unit cubes (in 2D: squares) with structured meshes of n × n × 1 cells are stacked and pressed
together. The lower one is the master, E = 3e4, the upper one the slave, E = 1.3e4; ν = 0. The
normal displacement is zero at the bottom, and the tangential ones are zero on the planes x = 0 and
y = 0 of both bodies, so that the exact solution is the uniform stress −65.

Without arguments both loads are solved with master-slave and quasi-symmetric contact, and a table
is printed beside the paper's. With arguments one case is solved:

    python3 demos/patch_test.py --master 8 --slave 3 --cell hexahedron --formulation master-slave
    mpirun -n 2 python3 demos/patch_test.py --load displacement --jitter 0.25 --json result.json
"""

import argparse
import dataclasses
import json
import pathlib
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

E_MASTER, E_SLAVE, STRESS = 3e4, 1.3e4, -65.0
CELLS = ("tetrahedron", "hexahedron", "triangle", "quadrilateral")
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
LAWS = {"tied": qs.Tied, "unilateral": qs.Unilateral}


@dataclasses.dataclass
class Parameters:
    """One patch test; lengths in units of the cubes' edges."""

    master: int = 5
    slave: int = 3
    cell: str = "tetrahedron"
    jitter: float = 0.0
    seed: int = 0
    formulation: str = "quasi-symmetric"
    load: str = "pressure"
    contact: str = "tied"
    penalty: float | str = "auto"
    quadrature: str = "nodal"
    quadrature_degree: int | None = None
    enforcement: str = "penalty"
    rotate: float = 0.0
    overhang: float = 0.0


def create_cube(comm, n, cell, bottom, jitter, rng):
    """Unit cube of n × n × 1 cells whose interface nodes are moved in their plane.

    Args:
        comm: Communicator.
        n: Cells along each edge of the interface.
        cell: Cell type.
        bottom: Height of the bottom; the interface is the plane at height 1.
        jitter: Largest distance of a node from its place, in units of the cell size.
        rng: Random generator, in the same state on all ranks.
    """
    kind = mesh.CellType[cell]
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    corners = [[0.0] * (gdim - 1) + [bottom], [1.0] * (gdim - 1) + [bottom + 1]]
    create = mesh.create_rectangle if gdim == 2 else mesh.create_box
    cube = create(comm, corners, [n] * (gdim - 1) + [1], kind)

    # One shift per lattice point, whichever ranks have the node.
    length = jitter / n * np.sqrt(rng.random((n + 1, n + 1)))
    angle = 2 * np.pi * rng.random((n + 1, n + 1))
    x = cube.geometry.x
    i, j = (np.rint(n * x[:, d]).astype(int) for d in (0, 1 if gdim == 3 else 2))
    inner = np.isclose(x[:, gdim - 1], 1) & (i > 0) & (i < n)
    if gdim == 3:
        inner &= (j > 0) & (j < n)
        x[inner, 1] += (length * np.sin(angle))[i[inner], j[inner]]
    x[inner, 0] += (length * np.cos(angle))[i[inner], j[inner]]
    return cube


def locate(cube, axis, value):
    """Boundary facets in a plane across an axis."""
    fdim = cube.topology.dim - 1
    return mesh.locate_entities_boundary(cube, fdim, lambda x: np.isclose(x[axis], value))


def rotation(degrees, gdim):
    """Matrix that turns by an angle, in 3D about the axis (1, 1, 0)."""
    angle = np.deg2rad(degrees)
    if gdim == 2:
        plane = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.block([[plane, np.zeros((2, 1))], [np.zeros((1, 2)), np.ones((1, 1))]])
    across = np.array([[0, 0, 1], [0, 0, -1], [-1, 1, 0]]) / np.sqrt(2)  # x ↦ axis × x
    return np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across


class Block:
    """An elastic cube, its conditions and its contact surface.

    Args:
        cube: Mesh in its place before it is turned.
        E: Young's modulus.
        p: Parameters of the test.
    """

    def __init__(self, cube, E, p):
        self.mesh, self.E = cube, E
        self.gdim = gdim = cube.geometry.dim
        up, bottom = gdim - 1, 0.0 if E == E_MASTER else 1.0
        left = p.overhang if E == E_SLAVE else 0.0
        sides = [(0, left)] + [(axis, 0.0) for axis in range(1, up)]
        self.sides = [(axis, locate(cube, axis, at)) for axis, at in sides]
        self.bottom, self.top = locate(cube, up, bottom), locate(cube, up, bottom + 1)
        interface = self.top if E == E_MASTER else self.bottom
        corner = np.isclose(cube.geometry.x[:, up], bottom + 1)
        for axis in range(1, up):
            corner &= np.isclose(cube.geometry.x[:, axis], 0)
        turn = rotation(p.rotate, gdim)
        self.normal = turn[:gdim, up]
        cube.geometry.x[:] = cube.geometry.x @ turn.T
        self.corner = cube.geometry.x[corner]
        self.V = fem.functionspace(cube, ("Lagrange", 1, (gdim,)))
        self.u = fem.Function(self.V)
        self.exact = fem.Function(self.V)  # with the loads of the test; set when ε is known
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        self.bcs = []
        self.surface = qs.Surface(self.V, facets=interface)

    @property
    def stress(self):
        """Stress of the linear elastic body, ν = 0."""
        return self.E * ufl.sym(ufl.grad(self.u))

    def normal_stress(self):
        """Stress across planes that were horizontal."""
        n = ufl.as_vector(self.normal)
        return ufl.dot(n, self.stress * n)

    def set_exact(self, offset):
        """The uniform solution, given the displacement at height 0 if the body went that far."""

        def u(x):
            height = self.normal @ x[: self.gdim]
            return np.outer(self.normal, offset + STRESS / self.E * height)

        self.exact.interpolate(u)

    def slide(self, axis, facets):
        """No displacement along an axis."""
        V = self.V.sub(axis)
        return fem.dirichletbc(0.0, fem.locate_dofs_topological(V, self.gdim - 1, facets), V)

    def prescribe(self, facets):
        """The exact displacement."""
        dofs = fem.locate_dofs_topological(self.V, self.gdim - 1, facets)
        return fem.dirichletbc(self.exact, dofs)

    def prescribe_corners(self):
        """The exact displacement at the two ends of an upper edge: holds the body, no more."""
        ends = np.array(self.corner)

        def at_ends(x):
            out = np.zeros(x.shape[1], dtype=bool)
            for end in ends:
                out |= np.linalg.norm(x.T - end, axis=1) < 1e-10
            return out

        return fem.dirichletbc(self.exact, fem.locate_dofs_geometrical(self.V, at_ends))

    def press(self):
        """Pressure on the top."""
        facets = np.sort(self.top)
        tags = mesh.meshtags(self.mesh, self.gdim - 1, facets, np.ones_like(facets))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        v = ufl.TestFunction(self.V)
        self.F -= STRESS * ufl.dot(ufl.as_vector(self.normal), v) * ds

    def interface_stress(self):
        """Mean normal stress of each owned cell with a facet on the interface."""
        q = ufl.TestFunction(fem.functionspace(self.mesh, ("DG", 0)))
        force = fem.assemble_vector(fem.form(self.normal_stress() * q * ufl.dx)).array
        volume = fem.assemble_vector(fem.form(q * ufl.dx)).array
        to_cell = self.mesh.topology.connectivity(self.gdim - 1, self.gdim)
        cells = np.unique([to_cell.links(facet)[0] for facet in self.surface.facets]).astype(int)
        return force[cells] / volume[cells]  # DG0 unknowns are numbered as cells


def build(comm, p):
    """The two blocks, their contact and the problem."""
    rng = np.random.default_rng(p.seed)
    master_cube = create_cube(comm, p.master, p.cell, 0.0, p.jitter, rng)
    slave_cube = create_cube(comm, p.slave, p.cell, 1.0, p.jitter, rng)
    slave_cube.geometry.x[:, 0] += p.overhang
    master, slave = Block(master_cube, E_MASTER, p), Block(slave_cube, E_SLAVE, p)
    if p.load == "pressure":
        slave.press()
    if p.rotate == 0:
        up = slave.gdim - 1
        master.bcs.append(master.slide(up, master.bottom))
        for block in (master, slave):
            block.bcs += [block.slide(*side) for side in block.sides]
        if p.load == "displacement":
            V = slave.V.sub(up)
            collapsed = V.collapse()[0]
            slave.lid = fem.Function(collapsed)
            dofs = fem.locate_dofs_topological((V, collapsed), up, slave.top)
            slave.bcs.append(fem.dirichletbc(slave.lid, dofs, V))
    else:
        # Conditions along one axis alone are none of DOLFINx: the exact displacement, where it
        # holds the bodies and does not disturb the uniform stress.
        master.bcs.append(master.prescribe(master.bottom))
        lid = slave.prescribe(slave.top) if p.load == "displacement" else slave.prescribe_corners()
        slave.bcs.append(lid)
    contact = qs.Contact(
        slave.surface,
        master.surface,
        p.formulation,
        LAWS[p.contact](),
        p.penalty,
        quadrature=p.quadrature,
        quadrature_degree=p.quadrature_degree,
        enforcement=p.enforcement,
        gap_tolerance=1e-13,
    )
    problem = qs.ContactProblem(
        [master.F, slave.F], [master.u, slave.u], [contact], [master.bcs, slave.bcs]
    )
    problem.set_up()  # an automatic penalty is known from here on
    # The compliance 1/ε is the penalty's; an augmented Lagrangian has none.
    compliance = 1 / contact.penalty if p.enforcement == "penalty" else 0.0
    jump = STRESS * (1 / E_MASTER - 1 / E_SLAVE + compliance)
    master.set_exact(0.0)
    slave.set_exact(jump)
    if p.rotate == 0 and p.load == "displacement":
        slave.lid.x.array[:] = jump + 2 * STRESS / E_SLAVE
    return master, slave, contact, problem


def mean_and_max(comm, values):
    """Over all ranks."""
    count, total = comm.allreduce(np.array([len(values), np.sum(values)]))
    return total / count, comm.allreduce(np.max(values, initial=0.0), op=MPI.MAX)


def normal_traction(contact, side, normal):
    """Normal contact force over nodal area at the owned nodes of one side."""
    surface = contact.slave if side == "slave" else contact.master
    local = surface.node_dofs - surface.V.dofmap.index_map.local_range[0] * surface.gdim
    return contact.traction(side).x.array[local] @ normal


def run(p, comm=MPI.COMM_WORLD):
    """Solve one patch test.

    Returns:
        What --json writes, the two blocks and the contact.
    """
    comm.barrier()
    start = time.perf_counter()
    master, slave, contact, problem = build(comm, p)
    problem.solve()
    forces = contact.force("slave"), contact.force("master")
    gap = np.nan_to_num(contact.gap())
    result = {
        "formulation": p.formulation,
        "load": p.load,
        "cell": p.cell,
        "n_master": p.master,
        "n_slave": p.slave,
        "dofs": sum(b.V.dofmap.index_map.size_global * slave.gdim for b in (master, slave)),
        "penalty": contact.penalty,
    }
    for name, block in (("slave", slave), ("master", master)):
        error = np.abs(block.interface_stress() / STRESS - 1)
        result[f"{name}_mean_error"], result[f"{name}_max_error"] = mean_and_max(comm, error)
    for name in ("slave", "master"):
        error = np.abs(np.abs(normal_traction(contact, name, slave.normal) / STRESS) - 1)
        result[f"{name}_nodal_max_error"] = mean_and_max(comm, error)[1]
    size = np.linalg.norm(gap, axis=1) if gap.ndim == 2 else np.abs(gap)
    result |= {
        "gap_max": mean_and_max(comm, size)[1],
        "snes_iterations": problem.num_iterations,
        "ksp_iterations": problem.num_linear_iterations,
        "force_imbalance": np.linalg.norm(forces[0] + forces[1]) / np.linalg.norm(forces[0]),
        "contact_seconds": comm.allreduce(contact.seconds, op=MPI.MAX),
        "total_seconds": comm.allreduce(time.perf_counter() - start, op=MPI.MAX),
    }
    return {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}, contact


# --- Command line


def count(text):
    """Number of cells."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def shift(text):
    """Jitter that leaves the mesh valid."""
    value = float(text)
    if not 0 <= value < 0.5:
        raise argparse.ArgumentTypeError("must be at least 0 and below 0.5")
    return value


def stiffness(text):
    """Penalty: "auto" or a positive number."""
    if text != "auto" and not (np.isfinite(float(text)) and float(text) > 0):
        raise argparse.ArgumentTypeError('must be "auto" or a positive number')
    return text if text == "auto" else float(text)


def seed(text):
    """Seed of the random generator."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("must not be negative")
    return value


def main():
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
    import patch_table  # which runs this test

    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--master", type=count, metavar="N", help="cells along an edge of the master's interface")
    add("--slave", type=count, metavar="N", help="the same of the slave's")
    add("--cell", choices=CELLS)
    add("--jitter", type=shift, metavar="F", help="move interior interface nodes by up to F × h")
    add("--seed", type=seed, metavar="S", help="of the jitter")
    add(
        "--formulation", choices=("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
    )
    add("--load", choices=("pressure", "displacement"))
    add("--contact", choices=tuple(LAWS))
    add("--penalty", type=stiffness, metavar="auto|FLOAT", help="ε, stress per length")
    add("--quadrature", choices=("nodal", "overlay"), help="where the gap is sampled")
    add("--quadrature-degree", type=count, metavar="N", help="of the rule on the overlay's pieces")
    add("--enforcement", choices=("penalty", "augmented-lagrangian"))
    add("--rotate", type=float, metavar="DEGREES", help="turn everything; about (1, 1, 0) in 3D")
    add("--overhang", type=float, metavar="FRACTION", help="shift the slave along x")
    add("--json", metavar="FILE", help="write the results of a single case as JSON")
    add("--plot", metavar="FILE", help="draw the contact traction (needs matplotlib)")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    given = {name: value for name, value in arguments.items() if value is not None}

    comm = MPI.COMM_WORLD
    if given or filename:
        result, _ = run(dataclasses.replace(default, **given), comm)
        if comm.rank == 0:
            print("\n".join(f"{key:24}{value}" for key, value in result.items()))
            if filename:
                with open(filename, "w") as file:
                    json.dump(result, file, indent=2)
    else:
        patch_table.table(comm)
    if picture:
        patch_table.plot(comm, picture)


if __name__ == "__main__":
    main()
