"""Indent an elasto-plastic block by a rigid cylinder, in and out: Newton iterations.

Plane strain, half of the block (12 × 8 mm, MINI element), E = 200 GPa, ν = 0.3, yield stress 300
MPa, hardening 1000 MPa, large strains; a cylinder of radius 4 mm goes 0.8 mm deep and comes out
again, with or without Coulomb friction.

    python3 bench/indentation_j2.py [--steps 16] [--cells 24] [--friction 0 0.3]

Printed for each friction coefficient: the steps (in and out, until the cylinder is free); the
iterations of a step, failed attempts included, in the median, at 90 % and at worst, and their sum;
the steps that were cut back; the force at full depth (N/mm, of the whole block); the mean pressure
over the contact width, divided by the flow stress of uniaxial tests in plane strain, 2/√3 (Y + H α)
at α = 0.2 a/R (Tabor's mean strain of a ball; fully plastic indentation gives about 2.6 to 3); and
the energy error: the cylinder's work, summed by the trapezoidal rule, less the energy stored,
dissipated and lost in friction, over the work.
"""

import argparse
import pathlib
import sys

from mpi4py import MPI

import numpy as np

from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances, write

WIDTH, HEIGHT, RADIUS, DEPTH = 12.0, 8.0, 4.0, 0.8  # mm
E, NU, YIELD, HARDENING = 200e3, 0.3, 300.0, 1000.0  # MPa


class Indentation:
    """Block, cylinder and stepper.

    Args:
        cells: Number of squares of four triangles along the half of the block.
        steps: Smallest number of steps on the way in.
        friction: Coulomb's coefficient.
        comm: Communicator.
    """

    def __init__(self, cells, steps, friction, comm=MPI.COMM_WORLD):
        corners, count = [[0, -HEIGHT], [WIDTH, 0]], [cells, round(cells * HEIGHT / WIDTH)]
        msh = mesh.create_rectangle(comm, corners, count, diagonal=mesh.DiagonalType.crossed)
        self.w = fem.Function(qs.materials.mini_space(msh))
        V = self.w.function_space.sub(0)
        self.body = qs.J2Plasticity(self.w, E, NU, YIELD, HARDENING)
        top = mesh.locate_entities_boundary(msh, 1, lambda x: np.abs(x[1]) < 1e-9)
        self.tool = qs.RigidSurface.cylinder(comm, [0, RADIUS], None, RADIUS)
        law = qs.Coulomb(friction) if friction else None
        self.contact = qs.Contact(qs.Surface(V, facets=top), self.tool, friction=law)
        bcs = [_fix(V, 0, lambda x: np.abs(x[0]) < 1e-9)]
        bcs += [_fix(V, axis, lambda x: x[1] < 1e-9 - HEIGHT) for axis in (0, 1)]
        self.problem = qs.ContactProblem([self.body.residual], [self.w], [self.contact], [bcs])

        def drive(t, dt):
            at = np.interp([t - dt, t], [0, 1, 2], [0, -DEPTH, 0])
            self.tool.displacement = [0, at[1] - at[0]]

        self.stepper = qs.TimeStepper(self.problem, 1 / steps, drive)

    def force(self):
        """Return the force on the cylinder, of the whole block. Collective."""
        return -2 * self.contact.force("slave")[1]

    def spent(self):
        """Return the energy stored, dissipated and lost in friction, whole block. Collective."""
        body = self.body.stored_energy() + self.body.dissipated_energy()
        return 2 * (body + self.contact.dissipated_energy())


def _fix(V, axis, where):
    """Fix a component of the displacement at zero on a line."""
    facets = mesh.locate_entities_boundary(V.mesh, 1, where)
    dofs = fem.locate_dofs_topological(V.sub(axis), 1, facets)
    return fem.dirichletbc(fem.Constant(V.mesh, 0.0), dofs, V.sub(axis))


def run(cells, steps, friction, comm=MPI.COMM_WORLD):
    """Press the cylinder in and take it out; return the entries of the table by name."""
    scene = Indentation(cells, steps, friction, comm)
    its, cut, work = [], 0, 0.0
    height, force, deepest = 0.0, 0.0, None
    for t in scene.stepper.run(2.0):
        scene.body.update()
        its.append(scene.stepper.num_iterations)
        cut += scene.stepper.num_cutbacks
        now, old = scene.force(), force
        lower = np.interp(t, [0, 1, 2], [0, -DEPTH, 0])
        work += (now + old) / 2 * (height - lower)
        height, force = lower, now
        if abs(t - 1) < 1e-9:
            deepest = now, scene.contact.patch()[0]
        if t > 1 and now <= 0:
            break
    spent = scene.spent()
    load, half = deepest
    flow = 2 / np.sqrt(3) * (YIELD + HARDENING * 0.2 * half / RADIUS)
    return {
        "friction": friction,
        "steps": len(its),
        "median": float(np.median(its)),
        "90%": float(np.percentile(its, 90)),
        "worst": max(its),
        "all": sum(its),
        "cutbacks": cut,
        "force": load,
        "constraint": load / (2 * half) / flow,
        "energy_error": (work - spent) / work,
    }


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cells", type=int, default=24)
    parser.add_argument("--steps", type=int, default=16)
    parser.add_argument("--friction", type=float, nargs="+", default=[0.0, 0.3])
    parser.add_argument("--json", metavar="FILE")
    p = parser.parse_args()
    show = print if MPI.COMM_WORLD.rank == 0 else lambda *_: None
    show("| μ | steps | median | 90 % | worst | all | cut back | F (N/mm) | p_m/k | energy |")
    show("|---|---|---|---|---|---|---|---|---|---|")
    rows = []
    for friction in p.friction:
        r = run(p.cells, p.steps, friction)
        rows.append(r)
        show(
            f"| {friction:g} | {r['steps']} | {r['median']:.0f} | {r['90%']:.0f} | {r['worst']} "
            f"| {r['all']} | {r['cutbacks']} | {r['force']:.1f} | {r['constraint']:.2f} "
            f"| {r['energy_error']:+.2%} |"
        )
    if p.json and MPI.COMM_WORLD.rank == 0:
        write(p.json, {"circumstances": circumstances(), "rows": rows})


if __name__ == "__main__":
    main()
