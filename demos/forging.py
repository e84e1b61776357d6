"""Forging: a hot-steel cylinder upset between elastic dies with finer contact faces.

A quarter of a Norton-Hoff cylinder (radius 10 mm, height 15 mm; K = 50 MPa sᵐ, m = 0.15), velocity-
based with the MINI element, between two elastic dies (E = 2.1e5 MPa), displacement-based. The lower
die is fixed, the top of the upper one moves down at 10 mm/s. The faces of the dies are finer than
the workpiece by --die-refinement; the workpiece carries the multipliers (--swap: the dies). Only
contact holds the workpiece vertically. There is no friction unless --friction names a law; friction
factors refer to the flow stress at the nominal strain rate, velocity over height.

    mpirun -n 2 python3 demos/forging.py --die-refinement 4 --json forging.json
    mpirun -n 2 python3 demos/forging.py --friction coulomb-tresca --mu 0.2 --m-bar 0.4
    python3 demos/forging.py --friction sticking --plot forging.png --animate forging.gif

Keys of the JSON object (forces of the whole cylinder):

- forming_force (N): force on the upper die at the end;
- force_balance_error: largest |force on a die + force on the workpiece| / |force| of all steps;
- die_traction_peak (MPa): largest pressure on the dies' nodes within 70 % of the contact's radius;
- die_traction_roughness: standard deviation over mean of the pressure there;
- unloaded_die_nodes: share of these nodes with less than a tenth of the mean pressure;
- volume_change: relative change of the workpiece's volume;
- steps, snes_iterations, total_seconds.

Pressures are contact forces over nodal areas. The barrelling is printed on the terminal.
"""

import contextlib
import dataclasses
import pathlib
import sys

from mpi4py import MPI

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common.command import Command, film_file, option, report, say
from common.film import Film
from common.friction import FRICTIONS, Friction
from common.measures import Clock
from forging_bodies import HEIGHT, SPEED, K, M, create_bodies
from forging_output import Record, barrelling

#: Penalty times h (MPa). A stiffer penalty makes the nodes of the workpiece hop from dent to dent.
PENALTY = 5e4
SIZES = {"coarse": 2.5, "medium": 1.7, "fine": 1.2}  # mm, cells of the workpiece


@dataclasses.dataclass
class Parameters:
    """One forging; lengths in mm."""

    die_refinement: float = option(4.0)
    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str = option("penalty", "the default is as accurate here, and faster")
    reduction: float = option(0.3)
    size: str = option("coarse", choices=tuple(SIZES))
    num_steps: int = option(15, name="--steps")
    swap: bool = option(False, "make the dies the slaves")
    m: float = option(M, "rate sensitivity")
    solver: str = option("auto", "linear solver")
    friction: str = option("none", choices=FRICTIONS)
    mu: float = option(0.3, "Coulomb's coefficient")
    m_bar: float = option(0.3, "friction factor: share of the shear yield stress")
    alpha: float = option(0.3, "factor of the consistency in Norton's law")
    output: str | None = option(None, "write fields, history.csv, checkpoint", metavar="FOLDER")
    restart: bool = option(False, "continue from --output's checkpoint")
    verbose: bool = False

    def __post_init__(self):
        if self.restart and not self.output:
            raise ValueError("--restart needs the --output of the run before")


def build(comm, p):
    """Build workpiece, dies, contacts, problem and stepper."""
    h = SIZES[p.size]
    return assemble(p, h, *create_bodies(comm, h, p.die_refinement))


def assemble(p, h, work, dies):
    """Build contacts, problem and stepper of given bodies; h (mm) is the size for the penalty."""
    dt = p.reduction * HEIGHT / SPEED / p.num_steps
    friction, contacts, turn = Friction(p, work.mesh, K, p.m), [], -1 if p.swap else 1
    for face, die in zip((work.lower, work.upper), dies, strict=True):
        contact = qs.Contact(
            *(face, die.surface)[::turn],
            formulation=p.formulation,
            penalty=PENALTY / h,
            quadrature=p.quadrature,
            enforcement=p.enforcement,
            gap_tolerance=1e-5,
            unknown=("velocity", "displacement")[::turn],
            dt=dt,
            friction=friction.law(),
        )
        contacts.append(contact)
    F, u = [work.F, *(die.F for die in dies)], [work.w, *(die.u for die in dies)]
    bcs = [body.bcs for body in (work, *dies)]
    problem = qs.ContactProblem(F, u, contacts, bcs, linear_solver=p.solver)

    def drive(t, dt):
        dies[1].height.value = -SPEED * t
        friction.set_rate(SPEED / (HEIGHT - SPEED * (t - dt / 2)))

    def solve(step):
        if step > 0:
            with contextlib.suppress(qs.ConvergenceError):
                return problem.solve()
        return qs.solve_with_continuation(problem, work.m, p.m)

    return work, dies, contacts, problem, qs.TimeStepper(problem, dt, drive, solve=solve)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Forge; return the results for --json, and what build() returns.

    ``on_step(scene, strain)`` is called at the start and after each step.
    """
    clock, t_end = Clock(comm), p.reduction * HEIGHT / SPEED
    scene = *_, stepper = build(comm, p)
    record = Record(comm, p, scene, t_end, SPEED)
    on_step = on_step or (lambda scene, strain: None)
    on_step(scene, record.strain)
    for _ in stepper.run(t_end):
        record.add_step()
        on_step(scene, record.strain)
    record.close()
    return record.result() | {"total_seconds": clock.seconds()}, scene


def main():
    command = Command(__doc__, Parameters, plot="draw the final state")
    command.add_file("--animate", film_file, "all steps as a GIF")
    p, a = command.parse()
    film = Film(HEIGHT, SPEED) if a.plot or a.animate else None
    result, scene = run(dataclasses.replace(p, verbose=True), on_step=film)
    radii = barrelling(scene[0])
    say("largest radius at mid height {:.5g}, at the dies {:.5g}".format(*radii))
    report(result, a.json, ".6g")
    if a.plot:
        film.plot(a.plot)
    if a.animate:
        film.animate(a.animate)


if __name__ == "__main__":
    main()
