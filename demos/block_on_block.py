"""A block is pressed on a larger, coarser one and dragged: it sticks, slips in part, and slips.

The upper block, 1 × 1 × 0.5 in cells of 1/6, carries a dead load on its top, N in total. The lower
one, 2 × 1.7 × 0.5 in cells of about 1/3, is held at its bottom. Both are elastic hexahedra with
E = 100 and ν = 0.3. The first step applies N; the next ones drag the top along x by prescribed
steps, while its nodes are free to move up and down, until all nodes in contact slip. Then the total
friction is μ N, but not all of it is along x: when it was pressed, the upper block spread to all
sides, and friction held it. So it is dragged further, by steps that are 25 times as large, until T,
the force along x, changes by less than 1e-7 μ N in a step. By then it slips along x, and T = μ N.

T is the reaction at the dragged nodes, where no contact force acts; N is what is applied. Points
and normals stay as they are paired at first (small sliding).

    python3 demos/block_on_block.py
    mpirun -n 2 python3 demos/block_on_block.py --quadrature overlay --mu 0.5 --json block.json
    python3 demos/block_on_block.py --quadrature overlay --n 2 --plot block.png

The table has, after each step, T / (μ N), the shares of the closed area that sticks and slips, the
energy that friction has taken, and Newton iterations. The demo checks itself and ends with status
1 if friction takes energy at a node that does not slip, or gives any back.

Keys of the JSON object:

- friction_force_error: |T − μ N| / (μ N) at the end;
- partial_slip_seen: 1 if in some step a part of the nodes in contact slips, 0 otherwise;
- energy_error: energy that friction took in the last step over the work of T in it, less 1;
- min_dissipation: least energy that friction took at a node in a step, over that work;
- stick_dissipation: largest energy that it took in a step at the nodes that stick, over that work;
- force_balance_error: largest, of all steps, of |F_slave + F_master| / N and |F_z − N| / N;
- snes_iterations: of all steps.
"""

import argparse
import dataclasses
import json
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from block_plot import Recorder
from output_file import output_file
from plotting import picture_file

LOAD, E, NU = 2.0, 100.0, 0.3
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
TWO_PASSES = ("double-pass", "two-half-pass")
#: Most steps to full slip, and after it; how much larger these are.
MAX_STEPS, MAX_SLIDES, SLIDE = 40, 10, 25


@dataclasses.dataclass
class Parameters:
    """One pair of blocks; lengths, forces and stresses in any consistent units."""

    mu: float = 0.3
    formulation: str = "quasi-symmetric"
    quadrature: str = "nodal"
    enforcement: str = "penalty"
    n: int = 1
    push: float = 2e-3


# --- Bodies


class Block:
    """An elastic box."""

    def __init__(self, comm, n, low, high):
        self.mesh = mesh.create_box(comm, [low, high], n, mesh.CellType.hexahedron)
        self.lower, self.upper = (
            mesh.locate_entities_boundary(self.mesh, 2, lambda x, z=z: np.isclose(x[2], z))
            for z in (low[2], high[2])
        )
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (3,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        stress = qs.materials.linear_elastic(self.u, E, NU)
        self.F = ufl.inner(stress, ufl.grad(self.v)) * ufl.dx

    def condition(self, axis, facets, value):
        """Condition on one component."""
        V = self.V.sub(axis)
        return fem.dirichletbc(value, fem.locate_dofs_topological(V, 2, facets), V)

    def sum(self, value):
        return self.mesh.comm.allreduce(value, op=MPI.SUM)


class Dragged(Block):
    """The upper block, with its load and the displacement of its top."""

    def __init__(self, comm, n):
        super().__init__(comm, n, [0.5, 0.35, 0.0], [1.5, 1.35, 0.5])
        facets = np.sort(self.upper)
        tags = mesh.meshtags(self.mesh, 2, facets, np.ones_like(facets))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        area = self.sum(fem.assemble_scalar(fem.form(fem.Constant(self.mesh, 1.0) * ds)))
        self.F += fem.Constant(self.mesh, LOAD / area) * self.v[2] * ds
        self.shift = fem.Constant(self.mesh, 0.0)
        zero = fem.Constant(self.mesh, 0.0)
        self.bcs = [self.condition(0, facets, self.shift), self.condition(1, facets, zero)]
        dofs = self.bcs[0].dof_indices()[0]
        self.dragged = dofs[dofs < self.V.dofmap.index_map.size_local * 3]
        self.residual = fem.form(self.F)

    def reaction(self):
        """Force along x on the dragged nodes. Collective."""
        b = fem.assemble_vector(self.residual)
        b.scatter_reverse(la.InsertMode.add)
        return self.sum(float(b.array[self.dragged].sum()))


def build(comm, p):
    """The upper block, contact and problem."""
    upper = Dragged(comm, (6 * p.n, 6 * p.n, 3 * p.n))
    lower = Block(comm, (6 * p.n, 5 * p.n, 2 * p.n), [0.0, 0.0, -0.5], [2.0, 1.7, 0.0])
    options = {"quadrature": p.quadrature, "enforcement": p.enforcement}
    if p.formulation in TWO_PASSES:
        # Multipliers on both sides cannot close every gap of meshes that do not match.
        options["gap_tolerance"] = 1e-4
    contact = qs.Contact(
        qs.Surface(upper.V, facets=upper.lower),
        qs.Surface(lower.V, facets=lower.upper),
        p.formulation,
        friction=qs.Coulomb(p.mu),
        **options,
    )
    zero = fem.Constant(lower.mesh, 0.0)
    held = [lower.condition(axis, lower.lower, zero) for axis in range(3)]
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.u, lower.u], [contact], [upper.bcs, held]
    )
    return upper, contact, problem


# --- Steps


def state(p, upper, contact):
    """What there is to say of a step. Collective."""
    comm = contact.comm
    areas, energies, least = np.zeros(2), np.zeros(2), 0.0
    for side in ("slave", "master") if p.formulation in TWO_PASSES else ("slave",):
        surface = contact.slave if side == "slave" else contact.master
        active, slipping = contact.active(side), contact.slipping(side)
        dissipation = contact.dissipation(side)
        for i, nodes in enumerate((active & ~slipping, slipping)):
            areas[i] += surface.node_area[nodes].sum()
        energies += dissipation[~slipping].sum(), dissipation[slipping].sum()
        least = min(least, dissipation.min(initial=0.0))
    areas, energies = comm.allreduce(areas, op=MPI.SUM), comm.allreduce(energies, op=MPI.SUM)
    force = contact.force("slave")
    unbalanced = force + contact.force("master"), [force[2] - LOAD]
    return {
        "shift": float(upper.shift.value),
        "ratio": upper.reaction() / (p.mu * LOAD),
        "stick": areas[0] / areas.sum(),
        "slip": areas[1] / areas.sum(),
        "energy": contact.dissipated_energy(),
        "step_energy": contact.step_dissipation(),
        "stick_energy": energies[0],
        "least": comm.allreduce(least, op=MPI.MIN),
        "balance": max(np.linalg.norm(f) for f in unbalanced) / LOAD,
    }


def sizes(p, table):
    """Displacements of the top in the steps to come; the table is that of the steps made."""
    yield 0.0  # pressing
    for _ in range(MAX_STEPS):
        if table[-1]["stick"] == 0:
            break
        yield p.push
    for _ in range(MAX_SLIDES):
        yield SLIDE * p.push
        if abs(table[-1]["ratio"] - table[-2]["ratio"]) < 1e-7:
            return


def run(p, comm=MPI.COMM_WORLD, look=None):
    """Press and drag; returns what --json writes, and the states after the steps.

    look is called with the upper block, the contact and the state after each step.
    """
    upper, contact, problem = build(comm, p)
    table = []
    for size in sizes(p, table):
        upper.shift.value += size
        problem.solve()
        table.append(state(p, upper, contact) | {"iterations": problem.num_iterations})
        if look is not None:
            look(upper, contact, table[-1])
    problem.destroy()
    work = table[-1]["ratio"] * p.mu * LOAD * (table[-1]["shift"] - table[-2]["shift"])
    result = {
        "friction_force_error": abs(table[-1]["ratio"] - 1),
        "partial_slip_seen": int(any(0 < row["slip"] < 1 for row in table)),
        "min_dissipation": min(row["least"] for row in table) / work,
        "stick_dissipation": max(abs(row["stick_energy"]) for row in table) / work,
        "energy_error": table[-1]["step_energy"] / work - 1,
        "force_balance_error": max(row["balance"] for row in table),
        "snes_iterations": sum(row["iterations"] for row in table),
    }
    return {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}, table


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--mu", type=float, default=default.mu, help="coefficient of friction, above 0")
    add("--formulation", choices=FORMULATIONS, default=default.formulation)
    add("--quadrature", choices=("nodal", "overlay"), default=default.quadrature)
    add("--enforcement", choices=("penalty", "augmented-lagrangian"), default=default.enforcement)
    add("--n", type=int, default=default.n, help="factor of the numbers of cells along an edge")
    add("--push", type=float, default=default.push, help="displacement of the top in a step")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="draw the friction in three states")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    p = Parameters(**arguments)
    if not p.mu > 0:
        parser.error("--mu must be positive")
    look = Recorder(p.mu * LOAD) if picture else None
    result, table = run(p, look=look)
    if MPI.COMM_WORLD.rank == 0:
        print("   shift    T / μN   sticks   slips   energy taken  iterations")
        for row in table:
            print(
                f"{row['shift']:8.4f}{row['ratio']:10.6f}{row['stick']:9.1%}{row['slip']:8.1%}"
                f"{row['energy']:15.6e}{row['iterations']:12}"
            )
        print("\n".join(f"{key:24}{value:.3g}" for key, value in result.items()))
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
        if picture:
            look.plot(picture)
    if result["min_dissipation"] < -1e-12 or result["stick_dissipation"] > 1e-12:
        sys.exit("friction takes energy without slip, or gives energy back")


if __name__ == "__main__":
    main()
