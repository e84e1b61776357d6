"""Contact patch test of Fourment & Popa (2005), Table 1: two elastic or two Newtonian cubes.

Two unit cubes (in 2D: squares) with structured meshes of n × n × 1 cells are stacked and pressed
together. The lower one is the master, the upper one the slave. The normal displacement is zero at
the bottom, and the tangential ones are zero on the planes x = 0 and y = 0, so that the exact
solution is the uniform stress −65.

Elastic, cases 1 and 2: E = 3e4 for the master and 1.3e4 for the slave, ν = 0. Newtonian, cases 3
and 4: incompressible, viscosity K = 200, with velocities and pressure (MINI element) and Δt = 1;
the other sides are free to move outwards. The reference is the stress in a single body that fills
both cubes.

Without arguments all cases are solved with master-slave and quasi-symmetric contact, and the
results are printed beside those of the paper. With arguments one case is solved:

    python3 demos/patch_test.py --master 8 --slave 3 --cell hexahedron --formulation master-slave
    mpirun -n 2 python3 demos/patch_test.py --load displacement --jitter 0.25 --json result.json
    python3 demos/patch_test.py --material newtonian --quadrature overlay
"""

import dataclasses
import pathlib
import sys
import warnings

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import patch_bodies
from common import patch_table, pictures
from common.command import Command, count, option, report, seed, shift, stiffness
from common.measures import Clock, mean_and_max
from patch_bodies import MATERIALS, STRESS, reference_stress

# This demo measures the error of nodal sampling with a finer master, so ignore its warning.
warnings.filterwarnings("ignore", "quadrature: ", qs.ContactWarning)

CELLS = ("tetrahedron", "hexahedron", "triangle", "quadrilateral")
LOADS = ("pressure", "displacement")
LAWS = {"tied": qs.Tied, "unilateral": qs.Unilateral}


@dataclasses.dataclass
class Parameters:
    """One patch test; lengths in units of the cubes' edges."""

    master: int = option(5, "cells along an edge of the master's interface", type=count)
    slave: int = option(3, "cells along an edge of the slave's interface", type=count)
    cell: str = option("tetrahedron", choices=CELLS)
    jitter: float = option(0.0, "move interior interface nodes by up to F × h", type=shift)
    seed: int = option(0, "seed of the jitter", type=seed)
    formulation: str = option("quasi-symmetric")
    load: str = option("pressure", "displacement: a velocity for fluids", choices=LOADS)
    contact: str = option("tied", choices=tuple(LAWS))
    penalty: float | str = option("auto", "ε, stress per length", type=stiffness)
    quadrature: str = option("nodal", "where the gap is sampled")
    quadrature_degree: int | None = option(None, "degree of the rule on segments", type=count)
    enforcement: str = option("penalty")
    rotate: float = option(0.0, "rotate everything; 3D: about (1, 1, 0)", metavar="DEGREES")
    overhang: float = option(0.0, "shift the slave along x", metavar="FRACTION")
    material: str = option("elastic", choices=tuple(MATERIALS))

    def __post_init__(self):
        patch_bodies.check(self.material, self.cell, self.overhang)


def build(comm, p):
    """Build the two cubes, their contact and the problem."""
    master, slave = patch_bodies.create_cubes(comm, p)
    slave.tied_edges = p.material == "newtonian" and p.contact == "tied"
    patch_bodies.set_conditions((master, slave), p.load, p.rotate)
    contact = qs.Contact(
        qs.Surface(slave.V, facets=slave.interface),
        qs.Surface(master.V, facets=master.interface),
        formulation=p.formulation,
        law=LAWS[p.contact](),
        penalty=p.penalty,
        quadrature=p.quadrature,
        quadrature_degree=p.quadrature_degree,
        enforcement=p.enforcement,
        gap_tolerance=slave.material.gap_tolerance,
        unknown=slave.material.unknown,
        dt=slave.material.dt,
    )
    problem = qs.ContactProblem(
        [master.F, slave.F], [master.u, slave.u], [contact], [master.bcs, slave.bcs]
    )
    problem.set_up()  # an automatic penalty is known from here on
    # The compliance 1/ε is the penalty's; an augmented Lagrangian has none.
    compliance = 1 / contact.penalty if p.enforcement == "penalty" else 0.0
    patch_bodies.set_exact(master, slave, STRESS * compliance / contact.model.kinematics.scale[0])
    return master, slave, contact, problem


def run(p, comm=MPI.COMM_WORLD):
    """Solve one patch test; return the results for --json, and the contact."""
    clock = Clock(comm)
    master, slave, contact, problem = build(comm, p)
    problem.solve()
    reference = reference_stress(comm, p)
    maps = [body.u.function_space.dofmap for body in (master, slave)]
    result = {
        "formulation": p.formulation,
        "load": p.load,
        "cell": p.cell,
        "n_master": p.master,
        "n_slave": p.slave,
        "dofs": sum(dofmap.index_map.size_global * dofmap.index_map_bs for dofmap in maps),
        "penalty": contact.penalty,
    }
    sides = {"slave": slave, "master": master}
    for side, body in sides.items():  # in the cells
        error = np.abs(body.interface_stress() / reference - 1)
        result[f"{side}_mean_error"], result[f"{side}_max_error"] = mean_and_max(comm, error)
    for side in sides:  # contact force over nodal area
        traction = getattr(contact, side).node_values(contact.traction(side)) @ slave.normal
        error = np.abs(np.abs(traction / reference) - 1)
        result[f"{side}_nodal_max_error"] = mean_and_max(comm, error)[1]
    gap = np.atleast_2d(np.nan_to_num(contact.gap()).T)  # a jump where the cubes are tied
    forces = [contact.force(side) for side in sides]
    return result | {
        "gap_max": mean_and_max(comm, np.linalg.norm(gap, axis=0))[1],
        "snes_iterations": problem.num_iterations,
        "ksp_iterations": problem.num_linear_iterations,
        "force_imbalance": np.linalg.norm(sum(forces)) / np.linalg.norm(forces[0]),
        "contact_seconds": comm.allreduce(contact.model.watch.total, op=MPI.MAX),
        "total_seconds": clock.seconds(),
    }, contact


def main():
    p, a = Command(__doc__, Parameters, plot="draw the contact traction").parse()
    if a.given or a.json:
        report(run(p)[0], a.json)
    else:
        patch_table.table(Parameters, run, reference_stress)
    if a.plot:
        pictures.patch_test(a.plot, Parameters, run, STRESS)


if __name__ == "__main__":
    main()
