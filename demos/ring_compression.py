"""Ring compression test: a ring between two flat dies, whose inner diameter tells the friction.

The ring has the proportions 6:3:2 of outer diameter, inner diameter and height (30, 15 and 10). It
is a Norton-Hoff body in velocities, axisymmetric, with the MINI element, between rigid dies, of
which the upper one comes down with constant velocity V. Only contact holds the ring. Friction
factors are of the flow stress at the nominal strain rate, V over the height.

Without friction every point moves with r √(h₀/h), and so does the inner radius. With friction it
grows less, hardly changes at friction factors from 0.15 to 0.2, and shrinks with more (Male &
Cockcroft 1964).

    python3 demos/ring_compression.py --friction tresca --m-bar 0.4 --json ring.json
    python3 demos/ring_compression.py --table
    python3 demos/ring_compression.py --plot docs/figures/ring_compression.png
    mpirun -n 2 python3 demos/ring_compression.py --friction coulomb --mu 0.1

Keys of the JSON object, at the end of the compression:

- inner_radius, outer_radius: at mid height, over their initial values;
- inner_radius_error: of the inner radius against r √(h₀/h), relative and signed: without friction
  an error, with friction what friction does;
- force: on the upper die;
- dissipated_energy: that friction took, of both dies;
- volume_change: relative;
- steps, snes_iterations.

Lengths are in mm, stresses in MPa. What folds from the sides on to a die is in contact too.

--table prints the change of the inner diameter over the reduction for several friction factors
(Tresca). On the terminal there is also the balance of energy: the work of the dies is what the ring
dissipates and what friction takes, to rounding where no node comes to a die or leaves it, and to
the order of the time step where sides fold.
"""

import argparse
import dataclasses
import json
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from forming_friction import Friction, FrictionParameters, add_arguments
from output_file import output_file
from plotting import picture_file
from upset_cylinder import facets_at

OUTER, INNER, HEIGHT = 15.0, 7.5, 10.0  # mm
K, M, SPEED = 50.0, 0.15, 10.0  # MPa sᵐ, -, mm/s
FACTORS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0)

#: Arguments that the table chooses itself.
FIXED = ("friction", "mu", "m_bar", "alpha")


@dataclasses.dataclass
class Parameters(FrictionParameters):
    """One compression."""

    reduction: float = 0.5
    num_steps: int = 25
    cells: int = 8
    verbose: bool = False


# --- Ring


class Ring:
    """Form, faces, and what is measured on it."""

    def __init__(self, comm, cells):
        # The number of cells is even over the height, so that nodes are at mid height.
        rows = 2 * round(cells * HEIGHT / (OUTER - INNER) / 2)
        self.mesh = mesh.create_rectangle(
            comm,
            [[INNER, 0], [OUTER, HEIGHT]],
            [cells, rows],
            diagonal=mesh.DiagonalType.crossed,
        )
        self.W = qs.materials.mini_space(self.mesh)
        self.w = fem.Function(self.W)
        self.m = fem.Constant(self.mesh, M)
        velocity = ufl.split(self.w)[0]
        stress = qs.materials.norton_hoff(
            velocity, K, self.m, 1e-3 * SPEED / HEIGHT, axisymmetric=True
        )
        self.F = qs.materials.incompressible(self.w, stress)
        weight = qs.materials.axisymmetric_weight(self.mesh)
        dx = ufl.Measure("dx", self.mesh, metadata={"quadrature_degree": 5})  # that of F
        rate = qs.materials.strain(velocity, axisymmetric=True)
        self._power = fem.form(weight * ufl.inner(stress, rate) * dx)
        self._volume = fem.form(weight * dx)
        self.faces = [
            qs.Surface(self.W.sub(0), facets=facets_at(self.mesh, 1, z), axisymmetric=True)
            for z in (0.0, HEIGHT)
        ]
        # What may fold on to a die: the sides without the facets next to the faces. With these the
        # edges would have more area than touches the die.
        side = mesh.locate_entities_boundary(
            self.mesh, 1, lambda x: (x[1] > 1e-6) & (x[1] < HEIGHT - 1e-6)
        )
        self.sides = qs.Surface(self.W.sub(0), facets=side, axisymmetric=True)
        r, z = self.mesh.geometry.x[:, 0], self.mesh.geometry.x[:, 1]
        middle = np.isclose(z, HEIGHT / 2)
        self._middle = [np.flatnonzero(middle & np.isclose(r, at)) for at in (INNER, OUTER)]

    def power(self):
        """What the ring dissipates. Collective."""
        return self._total(self._power)

    def volume(self):
        """Volume of the ring. Collective."""
        return self._total(self._volume)

    def radii(self):
        """Inner and outer radius at mid height over their initial values. Collective."""
        local = [self.mesh.geometry.x[nodes, 0].max(initial=0.0) for nodes in self._middle]
        inner, outer = (self.mesh.comm.allreduce(radius, op=MPI.MAX) for radius in local)
        return inner / INNER, outer / OUTER

    def _total(self, form):
        return self.mesh.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)


def build(comm, p):
    """Ring, contacts and the stepper."""
    ring = Ring(comm, p.cells)
    dies = [qs.RigidSurface.plane(comm, [0, z], [0, up]) for z, up in ((0.0, 1), (HEIGHT, -1))]
    dt = p.reduction * HEIGHT / SPEED / p.num_steps
    friction = Friction(p, ring.mesh, K, M)
    contacts = [
        qs.Contact(
            surface,
            die,
            enforcement="augmented-lagrangian",
            unknown="velocity",
            dt=dt,
            friction=friction.law(),
        )
        for die, face in zip(dies, ring.faces, strict=True)
        for surface in (face, ring.sides)
    ]
    problem = qs.ContactProblem([ring.F], [ring.w], contacts)

    def drive(t, dt):
        dies[1].displacement = [0, -SPEED * dt]
        friction.set_rate(SPEED / height_at(t - dt / 2))

    def solve(step):
        qs.solve_with_continuation(problem, ring.m, M)

    return ring, contacts, qs.TimeStepper(problem, dt, drive, solve=solve)


def height_at(t):
    """Height between the dies."""
    return HEIGHT - SPEED * t


# --- Compression


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Compress.

    Args:
        p: Parameters.
        comm: Communicator.
        on_step: Called as ``on_step(ring, contacts, stepper)`` after each step.

    Returns:
        What --json writes; the history, one row a step, with the energies so far; and the ring.
    """
    ring, contacts, stepper = build(comm, p)
    volume = ring.volume()
    end = p.reduction * HEIGHT / SPEED
    history = qs.History(comm, t_end=end, verbose=p.verbose)
    power, work, plastic, iterations, height = [], 0.0, 0.0, 0, HEIGHT
    stepper.on_solved = lambda: power.append(ring.power())
    for t in stepper.run(end):
        force = sum(contact.force("slave")[1] for contact in contacts[2:])
        work -= force * (height - height_at(t))
        height = height_at(t)
        plastic += power[-1] * stepper.last_dt
        friction = sum(contact.dissipated_energy() for contact in contacts)
        inner, outer = ring.radii()
        energies = {"work": work, "plastic": plastic, "friction": friction}
        energies["energy_error"] = (work - plastic - friction) / work
        row = {"reduction": 1 - height / HEIGHT, "inner_radius": inner, "outer_radius": outer}
        history.add(qs.step_row(stepper) | row | energies)
        iterations += stepper.num_iterations
        if on_step is not None:
            on_step(ring, contacts, stepper)
    history.close()
    result = {
        "inner_radius_error": inner * np.sqrt(height / HEIGHT) - 1,
        "inner_radius": inner,
        "outer_radius": outer,
        "force": abs(force),
        "dissipated_energy": friction,
        "volume_change": ring.volume() / volume - 1,
        "steps": stepper.num_steps,
        "snes_iterations": iterations,
    }
    result = {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}
    return result, history.rows, ring


def calibrate(p, factors=FACTORS, comm=MPI.COMM_WORLD):
    """Compressions with friction factors (Tresca) of which 0 is no friction.

    Returns:
        For each factor what :func:`run` returns.
    """
    return {
        factor: run(
            dataclasses.replace(
                p, friction="tresca" if factor else "none", m_bar=factor, verbose=False
            ),
            comm,
        )
        for factor in factors
    }


def print_table(results):
    """Change of the inner diameter (%) over the reduction, as in Male & Cockcroft's figure."""
    highest = max(rows[-1]["reduction"] for _, rows, _ in results.values())
    reductions = np.arange(0.1, highest + 1e-9, 0.1)
    head = "".join(f"{reduction:8.0%}" for reduction in reductions)
    print(f"m_bar{head}   force (kN)   friction/work   energy error   iterations")
    for factor, (result, rows, _) in results.items():
        known = [[row[key] for row in rows] for key in ("reduction", "inner_radius")]
        changes = 100 * (np.interp(reductions, *known) - 1)
        last = rows[-1]
        print(
            f"{factor:5.2f}"
            + "".join(f"{change:8.2f}" for change in changes)
            + f"{result['force'] / 1e3:13.1f}{last['friction'] / last['work']:16.3f}"
            f"{last['energy_error']:15.1e}{result['snes_iterations']:13}"
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Parameters()
    add_arguments(parser)
    parser.add_argument("--reduction", type=float, default=default.reduction)
    parser.add_argument("--steps", dest="num_steps", type=int, default=default.num_steps)
    parser.add_argument("--cells", type=int, default=default.cells, help="across the wall")
    parser.add_argument("--json", type=output_file, metavar="FILE")
    parser.add_argument("--table", action="store_true", help="for several friction factors")
    parser.add_argument(
        "--plot", type=picture_file, metavar="FILE", help="the table and three rings as a picture"
    )
    a = vars(parser.parse_args())
    filename, table, picture = (a.pop(name) for name in ("json", "table", "plot"))
    if table or picture:
        if filename:
            parser.error("--json is for one compression, without --table and --plot")
        given = [name for name in FIXED if a[name] != getattr(default, name)]
        if given:
            names = ", ".join("--" + name.replace("_", "-") for name in given)
            parser.error(f"{names}: --table and --plot have friction factors of their own (Tresca)")
        results = calibrate(Parameters(**a))
        if MPI.COMM_WORLD.rank == 0:
            print_table(results)
        if picture:
            from ring_plot import draw

            draw(results, picture)
        return
    result, rows, _ = run(Parameters(**a, verbose=True))
    if MPI.COMM_WORLD.rank == 0:
        for key in ("work", "plastic", "friction", "energy_error"):
            print(f"{key:20}{rows[-1][key]:.6g}")
        for key, value in result.items():
            print(f"{key:20}{value:.6g}")
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)


if __name__ == "__main__":
    main()
