"""Partial slip of two elastic cylinders against the closed form of Cattaneo (1938), Mindlin (1949).

Two half cylinders, R = 8, E = 200, ν = 0.3, plane strain, μ = 0.2, are pressed together by
P = p·2R, p = 0.625, and then loaded along x by Q = q·2R, q = 0.05851. Half width of the contact
b = 0.680778, peak pressure p0 = 9.35135; within c = b √(1 − Q/(μP)) = 0.496511 it sticks, and

    t(x) = μ p0/b [√(b² − x²) − √(c² − x²) where |x| < c],   t(0) = 0.506229, t(c) = 1.279571.

Both flat backs carry tractions: p, then q (the upper one along +x, the lower one along −x), and
with q a linear pressure 3 q x/R that takes the moment Q R of Q about the contact; without that the
contact pressure would have to move by Q R/P = 0.75, more than b (--tilting). So nothing tips, and
the contact transmits P and Q; three unknowns at the lower back's corners fix the rigid motion.
Turned by 180° about the contact the problem is the same, which a clamped back would spoil: the
bodies are strained alike at the contact, and the stick zone stays in the middle.

Triangles are graded to h at the contact on the slave, the upper body, and to ratio × h on the
master; --swap makes the lower body the slave.

    python3 demos/cattaneo_mindlin.py --h 0.02
    python3 demos/cattaneo_mindlin.py --formulation master-slave --quadrature nodal --json r.json
    python3 demos/cattaneo_mindlin.py --plot cattaneo_mindlin.png

Tractions are recovered from the contact forces, t_k = f_k / S_k, the normal one from those of the
gaps, the tangential one from those of friction, positive where it resists Q: along −x on the
upper body, along +x on the lower one. Errors are relative:

- peak_error: largest nodal normal traction against p0, of the side that is further off;
- l2_error_normal, l2_error_tangential: (Σ S_k (t_k − t(x_k))² / Σ S_k t(x_k)²)^½ over the nodes
  with |x_k| ≤ 1.6 b, of the worse side; the terminal has both sides;
- stick_radius_error: half the length Σ S_k of the slave nodes that stick, against c.

Normals are bisectors at nodes as well. Contact is linear about the undeformed meshes, where facets
are tilted by x/R: along their normals closing a gap of x²/R is a slip of x³/R², and pressing alone
makes tangential tractions as large as those of Q.
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

from hertz import FORMULATIONS, Hertz
from hertz_bodies import LOAD, Body, R, create_mesh
from output_file import output_file
from plotting import picture_file

MU, SHEAR = 0.2, 0.05851 * 2 * R
KEYS = ("peak_error", "l2_error_normal", "l2_error_tangential", "stick_radius_error")


@dataclasses.dataclass
class Parameters:
    """One problem; lengths as R."""

    h: float = 0.02
    ratio: float = 1.3
    swap: bool = False
    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"
    penalty: float | None = None
    friction_penalty: float | None = None
    normals: str | None = "bisector"
    steps: int = 1
    tilting: bool = False


class CattaneoMindlin(Hertz):
    """The closed form."""

    def __init__(self):
        super().__init__(2, "cylinders")
        self.c = self.a * np.sqrt(1 - SHEAR / (MU * LOAD))

    def normal(self, x):
        """Normal traction at x."""
        return self.p0 * np.sqrt(np.maximum(1 - (x / self.a) ** 2, 0))

    def tangential(self, x):
        """Tangential traction at x."""
        root = np.sqrt(np.maximum(self.a**2 - x**2, 0)) - np.sqrt(np.maximum(self.c**2 - x**2, 0))
        return MU * self.p0 / self.a * root


# --- Problem


def load_back(body, sign, tilting):
    """Tractions on the flat back, and the factor of the tangential ones."""
    ds, x = body.measure(body.far), ufl.SpatialCoordinate(body.mesh)[0]
    factor = fem.Constant(body.mesh, 0.0)
    p, q = LOAD / (2 * R), SHEAR / (2 * R)
    body.F += sign * p * body.v[1] * ds - sign * factor * q * body.v[0] * ds
    if not tilting:
        body.F -= factor * 3 * q * x / R * body.v[1] * ds
    return factor


def fix_motion(body, sign):
    """Hold three unknowns at the corners of the back, which is in balance without them."""
    for axis, side in ((0, -1), (1, -1), (1, 1)):
        V = body.V.sub(axis)
        corner = (side * R, sign * R)
        dofs = fem.locate_dofs_geometrical(
            (V, V.collapse()[0]),
            lambda x, at=corner: np.isclose(x[0], at[0]) & np.isclose(x[1], at[1]),
        )
        body.bcs.append(fem.dirichletbc(fem.Function(V.collapse()[0]), dofs, V))


@dataclasses.dataclass
class Scene:
    """Bodies, contact and problem."""

    exact: CattaneoMindlin
    bodies: dict
    contact: qs.Contact
    problem: qs.ContactProblem
    factors: list

    def load(self, steps):
        """Press, then shear; returns the iterations."""
        self.problem.solve()
        iterations = [self.problem.num_iterations]
        for step in range(1, steps + 1):
            for factor in self.factors:
                factor.value = step / steps
            self.problem.solve()
            iterations.append(self.problem.num_iterations)
        return iterations


def build(comm, p):
    """The scene before it is loaded."""
    exact = CattaneoMindlin()
    upper_is_slave = not p.swap
    bodies, factors = {}, []
    for sign in (1, -1):
        is_slave = (sign == 1) == upper_is_slave
        h = p.h if is_slave else p.ratio * p.h
        body = Body(create_mesh(comm, "half disc", sign, 2, h, exact.a), "half disc", sign)
        factors.append(load_back(body, sign, p.tilting))
        body.sign = sign
        bodies["slave" if is_slave else "master"] = body
    slave, master = bodies["slave"], bodies["master"]
    fix_motion(slave if p.swap else master, -1)
    contact = qs.Contact(
        slave.surface,
        master.surface,
        p.formulation,
        qs.Unilateral(),
        "auto" if p.penalty is None else p.penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        normals=p.normals,
        friction=qs.Coulomb(MU),
        friction_penalty=p.friction_penalty,
    )
    problem = qs.ContactProblem(
        [slave.F, master.F], [slave.u, master.u], [contact], [slave.bcs, master.bcs]
    )
    return Scene(exact, bodies, contact, problem, factors)


# --- Errors


def tractions(scene, side):
    """Normal and tangential traction at the nodes of one side."""
    body, surface = scene.bodies[side], scene.bodies[side].surface
    at = surface.node_dofs - surface.V.dofmap.index_map.local_range[0] * 2
    normal, tangential = (
        scene.contact.traction(side, part=part).x.array[at] for part in ("normal", "tangential")
    )
    return body.sign * normal[:, 1], -body.sign * tangential[:, 0]


def errors(scene, side):
    """Relative errors of one side: of the peak, of the normal and of the tangential traction."""
    exact, surface = scene.exact, scene.bodies[side].surface
    comm, x = surface.comm, surface.node_x[:, 0]
    near = np.abs(x) <= 1.6 * exact.a
    normal, tangential = tractions(scene, side)
    pairs = ((normal, exact.normal(x)), (tangential, exact.tangential(x)))
    local = [(surface.node_area * f**2)[near].sum() for t, e in pairs for f in (t - e, e)]
    squares = comm.allreduce(np.array(local))
    peak = comm.allreduce(np.max(normal, initial=0.0), op=MPI.MAX)
    return peak / exact.p0 - 1, *np.sqrt(squares[::2] / squares[1::2])


def stick_zone(contact):
    """Half the length of the slave nodes that stick, and their centre."""
    surface, sticks = contact.slave, contact.active() & ~contact.slipping()
    size, x = surface.node_area[sticks], surface.node_x[sticks, 0]
    length, moment = contact.comm.allreduce(np.array([size.sum(), size @ x]))
    return length / 2, moment / max(length, 1e-300)


def measure(scene):
    """What --json writes, and what the terminal shows besides."""
    exact, contact = scene.exact, scene.contact
    sides = {side: errors(scene, side) for side in ("slave", "master")}
    worst = [max((e[i] for e in sides.values()), key=abs) for i in range(3)]
    radius, centre = stick_zone(contact)
    result = dict(zip(KEYS, (*worst, radius / exact.c - 1), strict=True))
    more = {}
    for side, values in sides.items():
        more |= {f"{key}, {side}": v for key, v in zip(KEYS, values, strict=False)}
    for side in sides:
        force = contact.force(side)
        more[f"P error, {side}"] = abs(force[1]) / LOAD - 1
        more[f"Q error, {side}"] = abs(force[0]) / SHEAR - 1
        more[f"moment / (Q R), {side}"] = contact.moment(side, (0.0, 0.0))[0] / (SHEAR * R)
    length, closed = contact.patch()[0], contact.comm.allreduce(int(contact.active().sum()))
    facet = length / max(closed, 1)
    more |= {
        "facet of the slave": facet,
        "stick radius": radius,
        "stick radius error, facets": (radius - exact.c) / facet,
        "centre of the stick zone": centre,
        "contact radius error": length / 2 / exact.a - 1,
        "penalty": contact.penalty,
        "dofs": sum(b.V.dofmap.index_map.size_global * 2 for b in scene.bodies.values()),
    }
    return {k: float(v) for k, v in result.items()}, more


def run(p, comm=MPI.COMM_WORLD):
    """Solve; returns what --json writes, what the terminal shows besides, and the scene."""
    scene = build(comm, p)
    start = time.perf_counter()
    iterations = scene.load(p.steps)
    seconds = time.perf_counter() - start
    result, more = measure(scene)
    more |= {"iterations": iterations, "seconds": comm.allreduce(seconds, op=MPI.MAX)}
    return result, more, scene


def plot(p, filename, comm=MPI.COMM_WORLD):
    """Tractions on both sides over the closed form, nodal and overlay."""
    from cattaneo_plot import draw, profile

    columns = []
    for quadrature in ("nodal", "overlay"):
        scene = run(dataclasses.replace(p, quadrature=quadrature), comm)[2]
        lines = {
            side: profile(body.surface, tractions(scene, side))
            for side, body in scene.bodies.items()
        }
        columns.append((f"{p.formulation}, {quadrature}", lines))
    if comm.rank == 0:
        draw(scene.exact, MU, columns, filename)


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--h", type=float, help="size of the slave's cells at the contact")
    add("--ratio", type=float, help="size of the master's cells in h")
    add("--swap", action="store_true", default=None, help="make the lower body the slave")
    add("--formulation", choices=FORMULATIONS)
    add("--quadrature", choices=("nodal", "overlay"))
    add("--enforcement", choices=("penalty", "augmented-lagrangian"))
    add("--penalty", type=float, help="ε, stress per length")
    add("--friction-penalty", type=float, help="ε in tangential direction, stress per length")
    add("--normals", choices=("facet", "averaged", "bisector"))
    add("--steps", type=int, help="steps of the tangential load")
    add("--tilting", action="store_true", default=None, help="q alone, which tips the bodies")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="draw nodal and overlay contact")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    given = {name: value for name, value in arguments.items() if value is not None}
    p = dataclasses.replace(default, **given)
    if p.steps < 1:
        parser.error("--steps: at least 1")
    result, more, _ = run(p)
    if MPI.COMM_WORLD.rank == 0:
        print("\n".join(f"{key:30}{value}" for key, value in (result | more).items()))
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
    if picture:
        plot(p, picture)


if __name__ == "__main__":
    main()
