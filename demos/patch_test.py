"""Contact patch test of Fourment & Popa (2005), Table 1: two elastic or two Newtonian cubes.

Two unit cubes (in 2D: squares) with structured meshes of n × n × 1 cells are stacked and pressed
together. The lower one is the master, the upper one the slave. The normal displacement is zero at
the bottom, and the tangential ones are zero on the planes x = 0 and y = 0, so that the exact
solution is the uniform stress −65.

Elastic, cases 1 and 2: E = 3e4 of the master and 1.3e4 of the slave, ν = 0. Newtonian, cases 3
and 4: incompressible, viscosity K = 200, in velocities and pressure (MINI element) with Δt = 1; the
other sides are free to move outwards. The reference is the stress in one body on a mesh of the
height of both.

Without arguments all cases are solved with master-slave and quasi-symmetric contact, and a table
is printed beside the paper's. With arguments one case is solved:

    python3 demos/patch_test.py --master 8 --slave 3 --cell hexahedron --formulation master-slave
    mpirun -n 2 python3 demos/patch_test.py --load displacement --jitter 0.25 --json result.json
    python3 demos/patch_test.py --material newtonian --quadrature overlay
"""

import argparse
import dataclasses
import json
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from output_file import output_file
from patch_bodies import MATERIALS, STRESS, Body, create_block, set_conditions
from plotting import picture_file

# What a finer master does at nodes is what is measured here.
warnings.filterwarnings("ignore", "quadrature: ", qs.ContactWarning)

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
    material: str = "elastic"

    def __post_init__(self):
        if self.material not in MATERIALS:
            raise ValueError(f"--material: must be one of {', '.join(MATERIALS)}")
        if self.material == "newtonian":
            if self.cell not in ("tetrahedron", "triangle"):
                raise ValueError(
                    f"--cell: Newtonian cubes are of the MINI element, which needs tetrahedron or "
                    f"triangle cells, not {self.cell}"
                )
            if self.overhang:
                raise ValueError(
                    "--overhang: Newtonian cubes have no uniform flow to compare with where one of "
                    "them is not supported; use it with --material elastic"
                )


def build(comm, p):
    """The two cubes, their contact and the problem."""
    rng = np.random.default_rng(p.seed)
    master_cube = create_block(comm, p.master, p.cell, 0.0, 1.0, p.jitter, rng)
    slave_cube = create_block(comm, p.slave, p.cell, 1.0, 2.0, p.jitter, rng)
    slave_cube.geometry.x[:, 0] += p.overhang
    of_master, of_slave = MATERIALS[p.material]
    master = Body(master_cube, of_master, 0.0, 1.0, 0.0, p.rotate)
    slave = Body(slave_cube, of_slave, 1.0, 2.0, p.overhang, p.rotate)
    slave.tied_edges = p.material == "newtonian" and p.contact == "tied"
    set_conditions((master, slave), p.load, p.rotate)
    contact = qs.Contact(
        qs.Surface(slave.V, facets=slave.interface),
        qs.Surface(master.V, facets=master.interface),
        p.formulation,
        LAWS[p.contact](),
        p.penalty,
        quadrature=p.quadrature,
        quadrature_degree=p.quadrature_degree,
        enforcement=p.enforcement,
        gap_tolerance=of_slave.gap_tolerance,
        unknown=of_slave.unknown,
        dt=of_slave.dt,
    )
    problem = qs.ContactProblem(
        [master.F, slave.F], [master.u, slave.u], [contact], [master.bcs, slave.bcs]
    )
    problem.set_up()  # an automatic penalty is known from here on
    # The compliance 1/ε is the penalty's; an augmented Lagrangian has none.
    compliance = 1 / contact.penalty if p.enforcement == "penalty" else 0.0
    up = slave.up
    strain = of_master.strain(slave.gdim)[up] - of_slave.strain(slave.gdim)[up]
    master.set_exact(0.0)
    slave.set_exact(strain + STRESS * compliance / contact.scale[0])
    return master, slave, contact, problem


def reference_stress(comm, p):
    """Mean stress at the interface: of elastic cubes the analytical one, else that of one body.

    The body is the union of the two cubes, on the mesh of the master, under the same load.
    """
    if p.material == "elastic":
        return STRESS
    rng = np.random.default_rng(p.seed)  # as the master's: the same nodes at height 1
    union = create_block(comm, p.master, p.cell, 0.0, 2.0, p.jitter, rng)
    body = Body(union, MATERIALS[p.material][0], 0.0, 2.0, 0.0, p.rotate)
    set_conditions((body,), p.load, p.rotate)
    body.set_exact(0.0)
    problem = qs.ContactProblem([body.F], [body.u], [], [body.bcs])
    problem.solve()
    problem.destroy()
    return mean_and_max(comm, body.interface_stress())[0]


def count_unknowns(W):
    """On all ranks."""
    return W.dofmap.index_map.size_global * W.dofmap.index_map_bs


def mean_and_max(comm, values):
    """Over all ranks."""
    count, total = comm.allreduce(np.array([len(values), np.sum(values)]))
    return total / count, comm.allreduce(np.max(values, initial=0.0), op=MPI.MAX)


def normal_traction(contact, side, normal):
    """Normal contact force over nodal area at the owned nodes of one side."""
    surface = contact.slave if side == "slave" else contact.master
    return surface.node_values(contact.traction(side)) @ normal


def run(p, comm=MPI.COMM_WORLD):
    """Solve one patch test.

    Returns:
        What --json writes, the two blocks and the contact.
    """
    comm.barrier()
    start = time.perf_counter()
    master, slave, contact, problem = build(comm, p)
    problem.solve()
    reference = reference_stress(comm, p)
    forces = contact.force("slave"), contact.force("master")
    gap = np.nan_to_num(contact.gap())
    result = {
        "formulation": p.formulation,
        "load": p.load,
        "cell": p.cell,
        "n_master": p.master,
        "n_slave": p.slave,
        "dofs": sum(count_unknowns(b.u.function_space) for b in (master, slave)),
        "penalty": contact.penalty,
    }
    for name, block in (("slave", slave), ("master", master)):
        error = np.abs(block.interface_stress() / reference - 1)
        result[f"{name}_mean_error"], result[f"{name}_max_error"] = mean_and_max(comm, error)
    for name in ("slave", "master"):
        error = np.abs(np.abs(normal_traction(contact, name, slave.normal) / reference) - 1)
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
    import patch_table  # which runs this test

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--master", type=count, metavar="N", help="cells along an edge of the master's interface")
    add("--slave", type=count, metavar="N", help="the same of the slave's")
    add("--cell", choices=CELLS)
    add("--jitter", type=shift, metavar="F", help="move interior interface nodes by up to F × h")
    add("--seed", type=seed, metavar="S", help="of the jitter")
    add("--formulation", choices=FORMULATIONS)
    add("--material", choices=tuple(MATERIALS))
    add("--load", choices=("pressure", "displacement"), help="of Newtonian cubes: a velocity")
    add("--contact", choices=tuple(LAWS))
    add("--penalty", type=stiffness, metavar="auto|FLOAT", help="ε, stress per length")
    add("--quadrature", choices=("nodal", "overlay"), help="where the gap is sampled")
    add("--quadrature-degree", type=count, metavar="N", help="of the rule on the overlay's pieces")
    add("--enforcement", choices=("penalty", "augmented-lagrangian"))
    add("--rotate", type=float, metavar="DEGREES", help="turn everything; about (1, 1, 0) in 3D")
    add("--overhang", type=float, metavar="FRACTION", help="shift the slave along x")
    add(
        "--json",
        type=output_file,
        metavar="FILE",
        help="write the results of a single case as JSON",
    )
    add("--plot", type=picture_file, metavar="FILE", help="draw the contact traction")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    given = {name: value for name, value in arguments.items() if value is not None}

    try:
        p = Parameters(**given)
    except ValueError as error:
        parser.error(str(error))

    comm = MPI.COMM_WORLD
    if given or filename:
        result, _ = run(p, comm)
        if comm.rank == 0:
            print("\n".join(f"{key:24}{value}" for key, value in result.items()), flush=True)
            if filename:
                with open(filename, "w") as file:
                    json.dump(result, file, indent=2)
    else:
        patch_table.table(comm)
    if picture:
        patch_table.plot(comm, picture)


if __name__ == "__main__":
    main()
