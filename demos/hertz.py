"""Hertz contact: a cylinder or sphere on a block, and two cylinders, against the closed form.

E = 200 and ν = 0.3 everywhere, plane strain in 2D, radius R = 8, and a load of 10, applied as a
pressure on the flats. Symmetry planes cut the bodies in half (2D) or in four (3D); the block is
20 × 20 (× 20) and held at its bottom.

- block, 2D: a = 0.9628, p0 = 6.612, the half width and the peak pressure
- block, 3D: a = 0.8173, p0 = 7.147
- cylinders, 2D: a = 0.6808, p0 = 9.351, both flats loaded

Meshes of triangles or tetrahedra are graded to h at the contact on the master and ratio × h on the
slave, the round body; --swap makes the round body the master. Of two cylinders the upper one is the
slave, with h, and the ratio (1.3 by default) is the master's.

    python3 demos/hertz.py --h 0.025 --ratio 3 --quadrature overlay
    mpirun -n 2 python3 demos/hertz.py --dim 3 --h 0.1 --json result.json
    python3 demos/hertz.py --plot hertz.png

All errors are relative, and of the traction recovered from the contact forces, t_k = f_k / S_k:

- peak_error: largest nodal pressure against p0;
- l2_error: (Σ S_k (t_k − p(x_k))² / Σ S_k p(x_k)²)^½ over the nodes with |x_k| ≤ 1.6 a; with
  --integral the integral of the squared difference of the functions instead, of which about 1 % at
  h = 0.025 is that functions of degree 1 cannot follow Hertz's square root;
- radius_error: of the radius that the area of the closed slave nodes gives;
- force_error: of the contact force.
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
from dolfinx import fem

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from hertz_bodies import E_STAR, LOAD, Body, R, create_mesh
from output_file import output_file
from plotting import picture_file

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")


@dataclasses.dataclass
class Parameters:
    """One Hertz problem; lengths as R."""

    dim: int = 2
    case: str = "block"
    h: float = 0.05
    ratio: float | None = None
    swap: bool = False
    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"
    penalty: float | None = None
    normals: str | None = None
    integral: bool = False


class Hertz:
    """The closed form."""

    def __init__(self, dim, case):
        self.dim = dim
        radius = R if case == "block" else R / 2
        if dim == 2:
            self.a = np.sqrt(4 * LOAD * radius / (np.pi * E_STAR))
            self.p0 = 2 * LOAD / (np.pi * self.a)
        else:
            self.a = (3 * LOAD * radius / (4 * E_STAR)) ** (1 / 3)
            self.p0 = 3 * LOAD / (2 * np.pi * self.a**2)

    def pressure(self, x):
        """Pressure as a UFL expression."""
        r2 = sum(x[i] ** 2 for i in range(self.dim - 1)) / self.a**2
        return self.p0 * ufl.sqrt(ufl.max_value(1 - r2, 0))


# --- Problem


def build(comm, p):
    """Slave, master, contact and problem."""
    hertz = Hertz(p.dim, p.case)
    if p.case == "cylinders":
        shapes, sizes = ("round", "round"), (p.h, (p.ratio or 1.3) * p.h)
    else:
        shapes, sizes = ("round", "block"), ((p.ratio or 1.0) * p.h, p.h)
    bodies = [
        Body(create_mesh(comm, shape, sign, p.dim, h, hertz.a), shape, sign)
        for shape, sign, h in zip(shapes, (1, -1), sizes, strict=True)
    ]
    bodies[0].press(1)
    if p.case == "cylinders":
        bodies[1].press(-1)
        bodies[1].pin(-1)
    else:
        bodies[1].hold()
    slave, master = bodies[::-1] if p.swap else bodies
    contact = qs.Contact(
        slave.surface,
        master.surface,
        p.formulation,
        qs.Unilateral(),
        "auto" if p.penalty is None else p.penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        normals=p.normals,
    )
    problem = qs.ContactProblem(
        [slave.F, master.F], [slave.u, master.u], [contact], [slave.bcs, master.bcs]
    )
    return hertz, slave, master, contact, problem


# --- Errors


def errors(hertz, body, traction, integral=False):
    """Relative errors of the peak pressure and of the pressure in L2, see above."""
    surface, dim, comm = body.surface, body.dim, body.mesh.comm
    first = surface.V.dofmap.index_map.local_range[0] * dim
    pressure = -np.sum(
        traction.x.array[surface.node_dofs - first] * surface.node_normal[:, :dim], axis=1
    )
    r = np.linalg.norm(surface.node_x[:, : dim - 1], axis=1)
    exact = hertz.p0 * np.sqrt(np.maximum(1 - (r / hertz.a) ** 2, 0))
    near = r <= 1.6 * hertz.a
    local = [(surface.node_area * f**2)[near].sum() for f in (pressure - exact, exact)]
    if integral:
        x = ufl.SpatialCoordinate(body.mesh)
        p, t = hertz.pressure(x), -ufl.dot(traction, ufl.FacetNormal(body.mesh))
        r2 = sum(x[i] ** 2 for i in range(dim - 1))
        here = ufl.conditional(ufl.le(r2, (1.6 * hertz.a) ** 2), 1.0, 0.0)
        ds = body.ds(metadata={"quadrature_degree": 20})
        local = [fem.assemble_scalar(fem.form(f**2 * here * ds)) for f in (t - p, p)]
    squares = comm.allreduce(np.array(local))
    peak = comm.allreduce(np.max(pressure, initial=0.0), op=MPI.MAX)
    return peak / hertz.p0 - 1, np.sqrt(squares[0] / squares[1])


def run(p, comm=MPI.COMM_WORLD):
    """Solve; returns what --json writes, and the parts."""
    comm.barrier()
    hertz, slave, master, contact, problem = build(comm, p)
    start = time.perf_counter()
    problem.solve()
    seconds = time.perf_counter() - start
    result = {}
    for side, body in (("slave", slave), ("master", master)):
        peak, l2 = errors(hertz, body, contact.traction(side), p.integral)
        result[f"peak_error_{side}"], result[f"l2_error_{side}"] = peak, l2
    area = contact.patch()[0] * 2 ** (p.dim - 1)
    radius = area / 2 if p.dim == 2 else np.sqrt(area / np.pi)
    force = contact.force("slave")[p.dim - 1] * 2 ** (p.dim - 1)
    result |= {
        "radius_error": radius / hertz.a - 1,
        "force_error": abs(abs(force) / LOAD - 1),
        "dofs": sum(b.V.dofmap.index_map.size_global * p.dim for b in (slave, master)),
        "snes_iterations": problem.num_iterations,
        "augmentation_steps": problem.num_augmentations,
        "contact_seconds": comm.allreduce(contact.seconds, op=MPI.MAX),
        "total_seconds": comm.allreduce(seconds, op=MPI.MAX),
    }
    return {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}, contact


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--dim", type=int, choices=(2, 3))
    add("--case", choices=("block", "cylinders"))
    add("--h", type=float, help="size of the cells at the contact")
    add("--ratio", type=float, help="size of the coarser (or finer) side in h")
    add("--swap", action="store_true", default=None, help="exchange slave and master")
    add("--formulation", choices=FORMULATIONS)
    add("--quadrature", choices=("nodal", "overlay"))
    add("--enforcement", choices=("penalty", "augmented-lagrangian"))
    add("--penalty", type=float, help="ε, stress per length")
    add("--normals", choices=("facet", "averaged", "bisector"))
    add("--integral", action="store_true", default=None, help="l2_error of the function t")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="draw three kinds of contact")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    given = {name: value for name, value in arguments.items() if value is not None}
    result, _ = run(dataclasses.replace(default, **given))
    if MPI.COMM_WORLD.rank == 0:
        print("\n".join(f"{key:24}{value}" for key, value in result.items()))
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
    if picture:
        from hertz_plot import plot

        plot(dataclasses.replace(default, **given), picture)


if __name__ == "__main__":
    main()
