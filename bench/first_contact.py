"""Friction in the step of contact onset: forces and dissipation for fewer and fewer steps.

A block moves down and sideways along a straight path, and meets a floor, or a coarser block, after
0.897 of it. Printed are T/N and the energy dissipated by friction, relative to the results with the
largest number of steps, for laws, enforcements, displacement-based and velocity-based bodies, rigid
tools and two bodies, with problem.solve() and with a qs.TimeStepper (velocity-based bodies: only
with the stepper).

    python3 bench/first_contact.py [--laws Coulomb …] [--steps 1 2 5 10 50 200]
"""

import argparse
import itertools
import typing

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
#: Displacements of the block's upper side, and the initial gap.
DOWN, SIDEWAYS, OPEN = 0.01, 0.01, 0.00897
LAWS = {
    "Coulomb": lambda: qs.Coulomb(0.05),
    "Tresca": lambda: qs.Tresca(5e-4),
    "Norton": lambda: qs.Norton(0.3, 2e-3, 0.3),
    "sticking": lambda: qs.Sticking(),
}
NO_STEPPER, STEPPER = "solve()", "TimeStepper"


class Result(typing.NamedTuple):
    """Result of a run."""

    tangential: float
    normal: float
    dissipated: float

    @property
    def ratio(self):
        """Ratio T/N."""
        return self.tangential / self.normal


def body(low, n, held, kind, wider=0.0):
    """Make a block of unit height above ``low``; the returned value prescribes the end y = held."""
    corners = [[0.0 - wider, low], [1.0 + wider, low + 1.0]]
    msh = mesh.create_rectangle(COMM, corners, n, mesh.CellType.quadrilateral)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    # With velocities: a compressible fluid.
    F = ufl.inner(qs.materials.linear_elastic(u, 10.0, 0.3), ufl.grad(v)) * ufl.dx
    value = fem.Constant(msh, (0.0, 0.0))
    at = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], held))
    bc = fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, at), V)
    return V, F, u, [bc], value


def side(V, y):
    """Return the surface at this height."""
    at = mesh.locate_entities_boundary(V.mesh, 1, lambda x: np.isclose(x[1], y))
    return qs.Surface(V, facets=at)


def run(law, enforcement, kind, master, driver, steps, **options):
    """Make all steps of a scene."""
    V, F, u, bcs, top = body(OPEN, [6, 6], OPEN + 1, kind)
    Fs, us, conditions = [F], [u], [bcs]
    if master == "tool":
        other = qs.RigidSurface.plane(COMM, point=[0, 0], normal=[0, 1])
    else:
        W, G, w, fixed, _ = body(-1.0, [8, 4], -1.0, kind, 0.5)
        Fs, us, conditions = [F, G], [u, w], [bcs, fixed]
        other = side(W, 0.0)
    friction = LAWS[law]()
    dt = 1 / steps
    needs_dt = kind == "velocity" or friction.needs_dt
    contact = qs.Contact(
        side(V, OPEN),
        other,
        friction=friction,
        enforcement=enforcement,
        unknown=kind,
        **{"search_radius": 0.2, "quadrature": "overlay"} | ({"dt": dt} if needs_dt else {}),
        **options,
    )
    problem = qs.ContactProblem(Fs, us, [contact], conditions)
    way = np.array((SIDEWAYS, -DOWN))

    def drive(t, dt):
        top.value[:] = way * (1.0 if kind == "velocity" else t)

    if driver == STEPPER:
        for _ in qs.TimeStepper(problem, dt, drive).run(1.0):
            pass
    else:
        for i in range(steps):
            drive((i + 1) * dt, dt)
            problem.solve()
    T, N = contact.force("slave")
    out = Result(abs(T), N, contact.dissipated_energy())
    problem.destroy()
    return out


def scenes(laws):
    """Yield all combinations."""
    enforcements = ("penalty", "augmented-lagrangian")
    for law, enforcement, kind, master, driver in itertools.product(
        laws, enforcements, ("displacement", "velocity"), ("tool", "body"), (NO_STEPPER, STEPPER)
    ):
        if kind == "displacement" or driver == STEPPER:
            yield law, enforcement, kind, master, driver


def relative(value, reference):
    """Format a value over the value of the finest steps; "-" if the latter is zero."""
    return f"{value / reference:7.3f}" if abs(reference) > 1e-14 else "      -"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", nargs="+", choices=LAWS, default=list(LAWS))
    parser.add_argument("--steps", nargs="+", type=int, default=[1, 2, 5, 10, 50, 200])
    args = parser.parse_args()
    show = COMM.rank == 0
    if show:
        print(f"T/N, then dissipation, over those of {args.steps[-1]} steps; steps: {args.steps}")
    for scene in scenes(args.laws):
        results = [run(*scene, steps) for steps in args.steps]
        last = results[-1]
        ratios = " ".join(relative(r.ratio, last.ratio) for r in results)
        energies = " ".join(relative(r.dissipated, last.dissipated) for r in results)
        if show:
            name = ", ".join(scene)
            print(f"{name}\n    T/N        {last.ratio:9.4f}: {ratios}")
            print(f"    dissipated {last.dissipated:9.2e}: {energies}", flush=True)


if __name__ == "__main__":
    main()
