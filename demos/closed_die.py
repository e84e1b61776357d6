"""Forge a hot billet in 3D between two closed dies that are read from STL files, with flash.

The model is a quarter of a wheel with hub, web and rim. `closed_die_tools.py` draws both dies with
gmsh, with draft, roundings, a flash land and a gutter. The billet (Norton-Hoff, MINI element)
stands on the web of the lower die; the upper die moves down at 100 mm/s until the dies are closed.
The whole outer surface of the billet may touch both dies, with friction. The consistency falls with
the temperature. Plastic work and friction raise the temperature, and contact with the colder dies
lowers it. The billet is remeshed every few steps, and when a cell is too flat. At the end the lower
die, as an elastic solid with a face finer than the billet, is loaded by the tractions that were
recovered on the billet.

    mpirun -n 2 python3 demos/closed_die.py --plot closed_die.png --json closed_die.json
    python3 demos/closed_die.py --quick --animate closed_die.gif
    mpirun -n 2 python3 demos/closed_die.py --size 2 --penalty 1e5 --curve fine.csv
    mpirun -n 2 python3 demos/closed_die.py --against fine.csv

Keys of the JSON object:

- steps, remeshings: their numbers;
- volume_change: relative change of the billet's volume over the run;
- max_penetration: largest penetration of billet and die in all steps (mm);
- facet_size: mean edge of the billet's facets, for comparison with max_penetration (mm);
- filled: share of the cavity within the land that is filled at the end;
- force_max: largest force of the press, for the whole wheel (N);
- energy_error: work of the press, less dissipation, friction and the energy of the contact penalty,
  over the work; or the error of the billet's heat, over the heat of the work, if that is larger;
- die_traction_peak: largest traction on the elastic die (MPa);
- total_seconds: run time (s).
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from closed_die_forging import Forging

from closed_die_bodies import SPEED
from closed_die_output import Record, Stages, checks, compared, read_curve, write_curve
from closed_die_stress import ElasticDie
from common.command import Command, film_file, option, output_file, report, say
from common.measures import Clock

#: Parameters that --quick uses in place of the defaults.
QUICK = {"size": 3.6, "tool_size": 2.5, "advance": 1.2, "every": 7, "stroke": 20.0}


@dataclasses.dataclass
class Parameters:
    """One forging; lengths in mm."""

    size: float = option(2.6, "size of the billet's cells")
    tool_size: float = option(1.5, "largest size of the dies' facets")
    advance: float = option(1.0, "displacement of the press per step")
    flash: float = option(0.05, "excess volume of the billet over the cavity, relative")
    penalty: float = option(4e4, "penalty of contact with the dies, MPa/mm")
    friction: str = option("norton", choices=("norton", "coulomb-tresca", "none"))
    solver: str = option("auto", "linear solver")
    min_quality: float = option(0.04, "part of its quality that a cell has to keep")
    remesh_quality: float = option(0.08, "quality of the worst cell below which to remesh")
    thinning: float = option(0.04, "largest decrease of the flash thickness per step, relative")
    every: int = option(3, "largest number of steps between remeshings")
    stroke: float | None = option(None, "stroke of the press; by default until the dies are closed")
    quick: bool = option(False, "coarse, with a shorter stroke: at most two minutes")
    verbose: bool = False

    def __post_init__(self):
        for name, value in QUICK.items() if self.quick else ():
            if getattr(self, name) == getattr(Parameters, name):  # not given
                setattr(self, name, value)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Forge; return the results for --json, the scene, the elastic die, and the force curve."""
    clock, on_step = Clock(comm), on_step or (lambda scene, record: None)
    forging = Forging(p, comm)
    stepper, whole = forging.stepper, forging.whole
    record = Record(comm, whole, forging.scene, p.verbose)
    on_step(forging.scene, record)
    try:
        for _ in stepper.run((p.stroke or whole) / SPEED):
            record.add_step(forging.scene, stepper)
            forging.limit_step(whole - record.way)
            on_step(forging.scene, record)
    except (qs.StepError, qs.RemeshError) as error:
        say(f"ends before the dies are closed: {error}")
    die = ElasticDie(comm, p.tool_size)
    lower = forging.scene.contacts[0]
    die.load(lower.slave, lower.traction("slave"), stepper.last_dt)
    result = record.result(len(stepper.remeshings))
    result |= {"die_traction_peak": die.peaks()[0], "total_seconds": clock.seconds()}
    return result, forging.scene, die, record.curve


def main():
    command = Command(__doc__, Parameters, plot="sections, force over stroke, stress in the die")
    command.add_file("--animate", film_file, "all steps as a GIF")
    command.add_file("--curve", output_file, "write force over displacement of the press as CSV")
    command.add_file("--against", str, "compare this curve with the one of another run")
    p, a = command.parse()
    try:
        other = read_curve(a.against) if a.against else None
    except ValueError as error:
        command.error(f"--against: {error}")
    stages = Stages(p) if a.plot or a.animate else None
    result, scene, die, curve = run(dataclasses.replace(p, verbose=True), on_step=stages)
    force = ", ".join(f"{f / 1e3:.2f}" for f in (die.sent[2], die.arrived[2]))
    say(f"force of the billet on the lower die, and what the solid received (kN): {force}")
    say(f"unknowns of velocity and pressure on the last mesh: {scene.num_unknowns()}")
    report(result, a.json, ".6g")
    for line in checks(result):
        say(line)
    if a.curve and MPI.COMM_WORLD.rank == 0:
        write_curve(a.curve, curve)
    for line in compared(curve, other) if a.against else ():
        say(line)
    if a.plot:
        stages.plot(a.plot, die)
    if a.animate:
        stages.animate(a.animate)


if __name__ == "__main__":
    main()
