"""Convergence of time steps with Δt, and the influence of contact detection and cut-backs.

A block is pressed and pushed sideways, along smooth paths, by a rigid cylinder, a rotating tool of
facets, or an elastic body; with and without friction, or tied; displacement-based (neo-Hookean) and
velocity-based (Newtonian). Printed for each scene, as relative values:

- the change of final forces and positions when Δt is halved, and its order in Δt;
- the difference made by a second contact detection in each step, ``num_pairings=2``, and its order;
- the difference made by cut-backs, if every third step fails at first, and its order.

    python3 bench/orders.py [--scenes NAME …] [--steps 8 16 32 64]
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
#: Size of cells, displacements of the tool down and sideways, its rotation (radians).
H, DOWN, SIDEWAYS, TURN = 1 / 8, 0.12, 0.3, 0.15


class Scene(typing.NamedTuple):
    """Bodies, contact law and kind of steps of a scene."""

    unknown: str = "displacement"
    master: str = "cylinder"
    law: qs.Law | None = None
    friction: qs.Friction | None = None
    theta: float = 0.5
    enforcement: str = "augmented-lagrangian"


SCENES = {
    "elastic": Scene(),
    "elastic, penalty": Scene(enforcement="penalty"),
    "elastic, Coulomb": Scene(friction=qs.Coulomb(0.2)),
    "elastic, Norton": Scene(friction=qs.Norton(0.2, 0.5, 0.5)),
    "elastic, tied": Scene(law=qs.Tied()),
    "elastic, tied, penalty": Scene(law=qs.Tied(), enforcement="penalty"),
    "two elastic": Scene(master="body"),
    "two elastic, Coulomb": Scene(master="body", friction=qs.Coulomb(0.2)),
    "two elastic, tied": Scene(master="body", law=qs.Tied()),
    "turned tool": Scene(master="facets"),
    "turned tool, Coulomb": Scene(master="facets", friction=qs.Coulomb(0.2)),
    "turned tool, tied": Scene(master="facets", law=qs.Tied()),
    "flow, θ = 0": Scene(unknown="velocity", theta=0.0),
    "flow": Scene(unknown="velocity"),
    "flow, Coulomb": Scene(unknown="velocity", friction=qs.Coulomb(0.2)),
    "flow, Norton": Scene(unknown="velocity", friction=qs.Norton(0.2, 0.5, 0.5)),
    "flow, tied": Scene(unknown="velocity", law=qs.Tied()),
    "flow, turned tool": Scene(unknown="velocity", master="facets"),
}


def body(corners, h, held, scene, rounded=False):
    """Make a block with its contact surface opposite y = held, which the returned value moves."""
    n = [round((b - a) / h) for a, b in zip(*corners, strict=True)]
    msh = mesh.create_rectangle(COMM, corners, n, mesh.CellType.quadrilateral)
    other = corners[0][1] + corners[1][1] - held
    at, facing = (
        mesh.locate_entities_boundary(msh, 1, lambda x, y=y: np.isclose(x[1], y))
        for y in (held, other)
    )
    if rounded:  # so that no edge penetrates the other body
        x = msh.geometry.x
        x[:, 1] -= 0.4 * x[:, 1] * (x[:, 0] - 0.5) ** 2
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    law = qs.materials.linear_elastic if scene.unknown == "velocity" else qs.materials.neo_hookean
    # With velocities: a compressible fluid.
    F = ufl.inner(law(u, 10.0, 0.3), ufl.grad(v)) * ufl.dx
    value = fem.Constant(msh, (0.0, 0.0))
    bc = fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, at), V)
    return F, u, [bc], qs.Surface(V, facets=facing), value


def facets_tool():
    """Make a slightly rounded tool of facets, whose lowest point is the origin."""
    x = np.linspace(-1.5, 1.5, 61)
    x = np.stack((x, 0.08 * x**2), axis=1)
    i = np.arange(len(x) - 1)
    return qs.RigidSurface.triangulated(COMM, x, np.stack((i, i + 1), axis=1), [0.0, 0.0])


def way(t):
    """Return the tool's displacement until t, down and sideways, and its rotation; accelerated."""
    s = t * (1 + t) / 2
    return np.array((SIDEWAYS * s, -DOWN * s)), TURN * s


class Run:
    """A scene with a number of steps of equal size.

    Args:
        scene: The scene.
        steps: Number of steps.
        failing: Whether every third step fails at first.
        options: Options of the qs.TimeStepper.
    """

    def __init__(self, scene, steps, failing=False, **options):
        self.failing, self.failed = failing, -1
        lower = body([[0, 0], [1, 1]], H, 0.0, scene, scene.master == "body")
        forms, us, bcs, slave, _ = zip(lower, strict=True)
        forms, us, bcs = list(forms), list(us), list(bcs)
        self.tool = self.top = None
        if scene.master == "body":
            F, u, bc, master, self.top = body([[-0.5, 1.0], [1.5, 1.5]], H / 1.25, 1.5, scene)
            forms, us, bcs = [*forms, F], [*us, u], [*bcs, bc]
        elif scene.master == "cylinder":
            master = qs.RigidSurface.cylinder(COMM, [0.5, 3.0], None, 2.0)
        else:
            master = facets_tool()
            master.displacement = [0.5, 1.0]
            master.advance()
        self.tool = None if self.top else master
        self.scene, dt = scene, 1 / steps
        friction = scene.friction
        needs_dt = scene.unknown == "velocity" or (friction is not None and friction.needs_dt)
        contact = qs.Contact(
            slave[0],
            master,
            law=scene.law or qs.Unilateral(),
            friction=friction,
            enforcement=scene.enforcement,
            unknown=scene.unknown,
            quadrature="overlay",
            search_radius=0.2,
            **({"dt": dt} if needs_dt else {}),
        )
        self.problem = qs.ContactProblem(forms, us, [contact], bcs)
        self.stepper = qs.TimeStepper(
            self.problem, dt, self.drive, solve=self.solve, theta=scene.theta, **options
        )
        for _ in self.stepper.run(1.0):
            pass
        self.result = np.array(contact.force("slave")), self.positions()
        self.problem.destroy()

    def drive(self, t, dt):
        """Move the tool, or the upper side of the upper body, to its position at t."""
        (to, angle), (start, before) = way(t), way(t - dt)
        if self.tool is not None:
            self.tool.displacement = to - start
            if self.scene.master == "facets":
                self.tool.rotation = angle - before
        elif self.scene.unknown == "velocity":
            self.top.value[:] = (to - start) / dt
        else:
            self.top.value[:] = to

    def solve(self, step):
        """Solve the problem, or fail if it is the turn of this step to fail."""
        if self.failing and step % 3 == 1 and self.failed != step:
            self.failed = step
            raise qs.ConvergenceError(-5, [1.0], [])
        self.problem.solve()

    def positions(self):
        """Return integrals of the coordinates of the lower block, and of their products."""
        u = self.problem.u[0]
        x = ufl.SpatialCoordinate(u.function_space.mesh)
        at = x if self.scene.unknown == "velocity" else x + u
        parts = [at[i] * w * ufl.dx for i in range(2) for w in (1.0, x[0], x[1])]
        return np.array([COMM.allreduce(fem.assemble_scalar(fem.form(p))) for p in parts])


def differences(first, second):
    """Return the differences of forces and of positions, relative to their size."""
    return [np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(first, second, strict=True)]


def line(text, rows):
    """Return the differences for each number of steps, and their orders."""
    rows = np.array(rows)
    out = f"    {text:12s}"
    for name, column in zip(("force", "place"), rows.T, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            orders = np.log2(column[:-1] / column[1:])
        small = column < 1e-9
        shown = [f"{c:.1e}" for c in column]
        last = "-" if small[-1] or not np.isfinite(orders[-1]) else f"{orders[-1]:.1f}"
        out += f"  {name} {' '.join(shown)} order {last:>4s}"
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--steps", nargs="+", type=int, default=[8, 16, 32, 64])
    args = parser.parse_args()
    if COMM.rank == 0:
        print(f"relative differences for {args.steps} steps; order: of the last two")
    for name in args.scenes:
        scene = SCENES[name]
        plain = [Run(scene, n).result for n in (*args.steps, 2 * args.steps[-1])]
        paired = [Run(scene, n, num_pairings=2).result for n in args.steps]
        failed = [Run(scene, n, failing=True, easy=10**6).result for n in args.steps]
        lines = [line("Δt halved", [differences(a, b) for a, b in itertools.pairwise(plain)])]
        for text, other in (("two pairings", paired), ("cut-backs", failed)):
            pairs = zip(other, plain[:-1], strict=True)
            lines.append(line(text, [differences(a, b) for a, b in pairs]))
        if COMM.rank == 0:
            print(name, *lines, sep="\n", flush=True)


if __name__ == "__main__":
    main()
