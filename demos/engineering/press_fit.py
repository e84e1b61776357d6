"""A steel shaft that is shrunk into a hub, and pulled out of it by a quarter of its length.

Axisymmetric, linear elastic (E = 210 GPa, ν = 0.3): shaft Ø40 mm, hub Ø40/Ø80, both 40 mm long;
radii overlap by 20 µm. The first solve is the shrink fit, without friction: Lamé's pressure,
uniform. Then, with μ = 0.12, the end of the shaft is pulled; the hub is supported by a plate at
that end.

    python3 demos/engineering/press_fit.py --plot press_fit.png
    mpirun -n 2 python3 demos/engineering/press_fit.py --cells 24 --json press_fit.json

The pull at which the shaft slips is 2π a L μ p, reduced because the pull itself lowers the
pressure: the shaft gets thinner, and the hub, compressed, wider. With p = p₀ − c F along the shaft,
dF/dz = 2π a μ p gives F = p₀/c (1 − exp(−2π a L μ c)). Keys of the JSON object:

- pressure_error: mean pressure of the shrink fit over Lamé's pressure, − 1;
- force_error: largest pull over the closed form, − 1;
- friction_error: pull over μ N, − 1; the largest of all steps in which the whole shaft slips;
- pressure (MPa), force (kN), simple_force (kN): Lamé's p₀, computed pull, and 2π a L μ p₀.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

from dolfinx import fem

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from common import machine_parts
from common.command import Command, count, option, report
from common.limits import check
from press_fit_bodies import INTERFERENCE, LENGTH, NU, A, B, E, Ring

MU = 0.12
#: Displacements of the shaft's end (mm): until all of it slips, and on to a quarter of the length.
PULLS = (0.002, 0.004, 0.006, 0.008, 0.012, 0.02, *np.arange(1.0, 10.1, 1.0))
LIMITS = {"pressure_error": 3e-3, "force_error": 5e-3, "friction_error": 5e-3}


@dataclasses.dataclass
class Parameters:
    """Parameters of a press fit."""

    cells: int = option(16, "cells along the shaft; 1.4 times as many along the hub", type=count)


def closed_form():
    """Return Lamé's pressure, and the pull-out force with and without the loss of pressure."""
    p = INTERFERENCE / A * E * (B**2 - A**2) / (2 * B**2)  # one material, both ends free
    thinner = NU * A / E * (1 / (np.pi * A**2) + 1 / (np.pi * (B**2 - A**2)))  # per unit force
    c, simple = p * thinner / INTERFERENCE, 2 * np.pi * A * LENGTH * MU * p
    return p, p / c * (1 - np.exp(-simple * c / p)), simple


def run(p, comm=MPI.COMM_WORLD):
    """Shrink and pull; return displacements (mm), pulls and normal forces (N), and bodies."""
    shaft = Ring(comm, 0.0, A + INTERFERENCE, A + INTERFERENCE, p.cells)
    hub = Ring(comm, A, B, A, round(1.4 * p.cells))
    mu = fem.Constant(hub.mesh, 0.0)
    contact = qs.Contact(hub.surface, shaft.surface, friction=qs.Coulomb(mu))
    bodies = hub, shaft
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )
    ways, rows = (0.0, 0.0, *PULLS), []

    def drive(t, dt):
        shaft.pulled.value = np.interp(t, range(len(ways)), ways)
        mu.value = MU if t > 1 else 0.0

    stepper = qs.TimeStepper(problem, 1.0, drive)
    for _ in stepper.run(len(ways) - 1.0):
        normal, pull = np.abs(contact.force("slave"))
        rows.append((float(shaft.pulled.value), pull, normal))
    return rows, bodies


def summary(rows):
    """Return the --json object."""
    (_, _, shrunk), *pulled = rows
    lame, exact, simple = closed_form()
    force = max(pull for _, pull, _ in pulled)
    slipping = [abs(pull / (MU * normal) - 1) for way, pull, normal in pulled if way > 0.01]
    return {
        "pressure_error": shrunk / (2 * np.pi * A * LENGTH) / lame - 1,
        "force_error": force / exact - 1,
        "friction_error": max(slipping),
        "pressure": lame,
        "force": force / 1e3,
        "simple_force": simple / 1e3,
    }


def main():
    p, a = Command(__doc__, Parameters, plot="draw the pulled shaft, and forces").parse()
    rows, bodies = run(p)
    result = summary(rows)
    report(result, a.json, ".5g")
    check(result, LIMITS)
    if a.plot:
        machine_parts.press_fit(a.plot, bodies, np.array(rows).T[:2], LENGTH, closed_form()[1:])


if __name__ == "__main__":
    main()
