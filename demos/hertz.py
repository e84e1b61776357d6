"""Hertz contact: a cylinder or sphere on a block, and two cylinders, against the closed form.

E = 200 and ν = 0.3 everywhere, plane strain in 2D, radius R = 8, and a load of 10, applied as a
pressure on the flats. By symmetry, half (2D) or a quarter (3D) of the bodies is modelled; the block
is 20 × 20 (× 20) and held at its bottom. At the contact cells have the size h on the master and
ratio × h on the slave, the round body; --swap makes the round body the master. With two cylinders
the upper one is the slave, with cells of h, and the master has ratio × h (ratio 1.3 by default).

    python3 demos/hertz.py --h 0.025 --ratio 3
    mpirun -n 2 python3 demos/hertz.py --dim 3 --h 0.1 --json result.json
    python3 demos/hertz.py --plot hertz.png

All errors are relative, for the traction recovered from the contact forces, t_k = f_k / S_k:

- peak_error: largest nodal pressure against p0;
- l2_error: (Σ S_k (t_k − p(x_k))² / Σ S_k p(x_k)²)^½ over the nodes with |x_k| ≤ 1.6 a; with
  --integral the integral of the squared difference of the functions instead, of which about 1 % at
  h = 0.025 is interpolation error: functions of degree 1 cannot represent Hertz's square root;
- radius_error: error of the contact radius, computed from the area of the active slave nodes;
- force_error: error of the contact force.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures
from common.bodies import integral
from common.command import Command, option, report
from common.measures import Clock, relative_l2
from hertz_bodies import LOAD, Body, Hertz, R, create_mesh


@dataclasses.dataclass
class Parameters:
    """One Hertz problem; lengths as R."""

    dim: int = option(2, choices=(2, 3))
    case: str = option("block", choices=("block", "cylinders"))
    h: float = option(0.05, "size of the cells in the contact zone")
    ratio: float | None = option(None, "cell size of the coarser (or finer) side over h")
    swap: bool = option(False, "exchange slave and master")
    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str = option("penalty", "the default is as accurate here, and faster")
    penalty: float | None = option(None, "ε, stress per length")
    normals: str | None = option(None)
    constraints: str | None = option(None)
    integral: bool = option(False, "integrate l2_error as a function")


def build(comm, p):
    """Build closed form, slave, master, contact and problem."""
    hertz = Hertz(p.dim, p.case)
    if p.case == "cylinders":
        shapes, sizes = ("round", "round"), (p.h, (p.ratio or 1.3) * p.h)
    else:
        shapes, sizes = ("round", "block"), ((p.ratio or 1.0) * p.h, p.h)
    upper, lower = (
        Body(create_mesh(comm, shape, sign, p.dim, h, hertz.a), shape, sign)
        for shape, sign, h in zip(shapes, (1, -1), sizes, strict=True)
    )
    upper.press(1)
    if p.case == "cylinders":
        lower.press(-1)
        lower.pin(1, 0.0, -R)
    else:
        lower.hold()
    slave, master = (lower, upper) if p.swap else (upper, lower)
    contact = qs.Contact(
        slave.surface,
        master.surface,
        formulation=p.formulation,
        penalty="auto" if p.penalty is None else p.penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        normals=p.normals,
        constraints=p.constraints,
    )
    problem = qs.ContactProblem(
        [slave.F, master.F], [slave.u, master.u], [contact], [slave.bcs, master.bcs]
    )
    return hertz, slave, master, contact, problem


def errors(hertz, body, traction, integrated=False):
    """Compute the relative errors of the peak pressure and of the pressure in L2. Collective."""
    surface, dim = body.surface, body.dim
    pressure = -np.sum(surface.node_values(traction) * surface.node_normal[:, :dim], axis=1)
    peak = surface.comm.allreduce(np.max(pressure, initial=0.0), op=MPI.MAX)
    r = np.linalg.norm(surface.node_x[:, : dim - 1], axis=1)
    l2 = relative_l2(surface, pressure, hertz.pressure(r), r <= 1.6 * hertz.a)
    if integrated:
        x = ufl.SpatialCoordinate(body.mesh)
        r = ufl.sqrt(sum(x[i] ** 2 for i in range(dim - 1)))
        exact = hertz.pressure(r, ufl.sqrt, ufl.max_value)
        difference = exact + ufl.dot(traction, ufl.FacetNormal(body.mesh))
        here, ds = ufl.conditional(ufl.le(r, 1.6 * hertz.a), 1.0, 0.0), body.ds(degree=20)
        squares = [integral(body.mesh, f**2 * here * ds) for f in (difference, exact)]
        l2 = np.sqrt(squares[0] / squares[1])
    return peak / hertz.p0 - 1, l2


def run(p, comm=MPI.COMM_WORLD):
    """Solve; return the results for --json, and what build() returns."""
    scene = hertz, slave, master, contact, problem = build(comm, p)
    clock = Clock(comm)
    problem.solve()
    seconds = clock.seconds()
    result = {}
    for side, body in (("slave", slave), ("master", master)):
        peak, l2 = errors(hertz, body, contact.traction(side), p.integral)
        result |= {f"peak_error_{side}": peak, f"l2_error_{side}": l2}
    area = contact.patch()[0] * slave.parts
    radius = area / 2 if p.dim == 2 else np.sqrt(area / np.pi)
    return result | {
        "radius_error": radius / hertz.a - 1,
        "force_error": abs(abs(contact.force("slave")[p.dim - 1]) * slave.parts / LOAD - 1),
        "dofs": sum(b.V.dofmap.index_map.size_global * p.dim for b in (slave, master)),
        "snes_iterations": problem.num_iterations,
        "augmentation_steps": problem.num_augmentations,
        "contact_seconds": comm.allreduce(contact.model.watch.total, op=MPI.MAX),
        "total_seconds": seconds,
    }, scene


def main():
    p, a = Command(__doc__, Parameters, plot="draw three kinds of contact").parse()
    report(run(p)[0], a.json)
    if a.plot:
        pictures.hertz(a.plot, p, lambda case: run(case)[1])


if __name__ == "__main__":
    main()
