"""Partial slip of two elastic cylinders against the closed form of Cattaneo (1938), Mindlin (1949).

Two half cylinders, R = 8, E = 200, ν = 0.3, plane strain, μ = 0.2, are pressed together by
P = p·2R, p = 0.625, and then loaded along x by Q = q·2R, q = 0.05851. The half width of the contact
is b = 0.680778, the peak pressure p0 = 9.35135, the half width of the stick zone
c = b √(1 − Q/(μP)) = 0.496511, and the tangential traction is

    t(x) = μ p0/b [√(b² − x²) − √(c² − x²) where |x| < c],   t(0) = 0.506229, t(c) = 1.279571.

Triangles have the size h at the contact on the slave (the upper body), and ratio × h on the master;
--swap makes the lower body the slave.

    python3 demos/cattaneo_mindlin.py --h 0.02
    python3 demos/cattaneo_mindlin.py --formulation master-slave --quadrature nodal --json r.json
    python3 demos/cattaneo_mindlin.py --plot cattaneo_mindlin.png

Tractions t_k = f_k / S_k are recovered from normal and friction forces. The tangential traction is
positive where it resists Q: along −x on the upper body, +x on the lower one. Errors are relative:

- peak_error: largest nodal normal traction against p0, on the side with the larger error;
- l2_error_normal, l2_error_tangential: (Σ S_k (t_k − t(x_k))² / Σ S_k t(x_k)²)^½ over the nodes
  with |x_k| ≤ 1.6 b, larger value of both sides; the terminal shows both;
- stick_radius_error: half the length Σ S_k of the slave nodes that stick, against c.
"""

import dataclasses
import pathlib
import sys
import types

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.command import Command, option, report
from common.measures import Clock, relative_l2, stick_zone
from hertz_bodies import LOAD, CattaneoMindlin, R, create_half_discs

MU, SHEAR = 0.2, 0.05851 * 2 * R
KEYS = ("peak_error", "l2_error_normal", "l2_error_tangential", "stick_radius_error")


@dataclasses.dataclass
class Parameters:
    """One problem; lengths as R."""

    h: float = option(0.02, "size of the slave's cells in the contact zone")
    ratio: float = option(1.3, "size of the master's cells over h")
    swap: bool = option(False, "make the lower body the slave")
    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str = option("penalty", "the default is as accurate here, and faster")
    penalty: float | None = option(None, "ε, stress per length")
    friction_penalty: float | None = option(None, "ε in tangential direction, stress per length")
    constraints: str | None = option(None)
    normals: str = option("bisector")
    steps: int = option(1, "steps of the tangential load")
    tilting: bool = option(False, "q without the linear pressure: the bodies tip")


def build(comm, p):
    """Build closed form, bodies, contact and problem, and the load factor of Q on each body."""
    exact = CattaneoMindlin(MU, SHEAR)
    sizes = (p.ratio * p.h, p.h) if p.swap else (p.h, p.ratio * p.h)
    upper, lower = create_half_discs(comm, sizes, exact.a)
    factors = [body.press_and_shear(SHEAR, p.tilting) for body in (upper, lower)]
    slave, master = (lower, upper) if p.swap else (upper, lower)
    contact = qs.Contact(
        slave.surface,
        master.surface,
        formulation=p.formulation,
        penalty="auto" if p.penalty is None else p.penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        constraints=p.constraints,
        normals=p.normals,
        friction=qs.Coulomb(MU),
        friction_penalty=p.friction_penalty,
    )
    problem = qs.ContactProblem(
        [slave.F, master.F], [slave.u, master.u], [contact], [slave.bcs, master.bcs]
    )
    bodies = {"slave": slave, "master": master}
    made = {"exact": exact, "bodies": bodies, "contact": contact, "problem": problem}
    return types.SimpleNamespace(**made, factors=factors)


def load(scene, steps):
    """Press, then shear; yield the number of iterations of each step."""
    for step in range(steps + 1):
        for factor in scene.factors:
            factor.value = step / steps
        scene.problem.solve()
        yield scene.problem.num_iterations


def tractions(scene, side):
    """Compute the normal and the tangential traction at the nodes of one side."""
    body = scene.bodies[side]
    normal, tangential = (
        body.surface.node_values(scene.contact.traction(side, part=part))
        for part in ("normal", "tangential")
    )
    return body.sign * normal[:, 1], -body.sign * tangential[:, 0]


def errors(scene, side):
    """Compute relative errors of one side: peak, normal and tangential traction."""
    exact, surface = scene.exact, scene.bodies[side].surface
    x, (normal, tangential) = surface.node_x[:, 0], tractions(scene, side)
    peak = surface.comm.allreduce(np.max(normal, initial=0.0), op=MPI.MAX)
    pairs = (normal, exact.normal(x)), (tangential, exact.tangential(x))
    near = np.abs(x) <= 1.6 * exact.a
    return peak / exact.p0 - 1, *(relative_l2(surface, *pair, near) for pair in pairs)


def run(p, comm=MPI.COMM_WORLD):
    """Solve; return the results for --json, further results for the terminal, and the scene."""
    scene = build(comm, p)
    clock = Clock(comm)
    iterations = list(load(scene, p.steps))
    seconds = clock.seconds()
    sides = {side: errors(scene, side) for side in ("slave", "master")}
    worst = [max(values, key=abs) for values in zip(*sides.values(), strict=True)]
    zone = radius, _ = stick_zone(scene.contact)
    result = dict(zip(KEYS, (*worst, radius / scene.exact.c - 1), strict=True))
    more = {f"{key}, {s}": e for s in sides for key, e in zip(KEYS, sides[s], strict=False)}
    more |= tables.cattaneo_mindlin(scene, LOAD, SHEAR, R, *zone)
    more |= {"iterations": iterations, "seconds": seconds}
    return result, more, scene


def main():
    command = Command(__doc__, Parameters, plot="draw nodal and overlay contact")
    p, a = command.parse()
    if p.steps < 1:
        command.error("--steps: at least 1")
    result, more, _ = run(p)
    report(result, a.json, more=more)
    if a.plot:
        pictures.cattaneo_mindlin(a.plot, p, lambda case: run(case)[2], tractions)


if __name__ == "__main__":
    main()
