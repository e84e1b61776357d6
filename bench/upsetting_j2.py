"""Upset an elasto-plastic billet, Ø20 × 30 mm, by 60 % between sticking dies.

The classic test of Lippmann (Metal Forming Plasticity, 1979), Taylor (1981) and Taylor & Becker
(1983): E = 200 GPa, ν = 0.3, yield stress 700 MPa, hardening 300 MPa. Axisymmetric, the upper half:
the die comes down by 9 mm, and the side of the billet folds onto it. Contact is with a rigid plane
and qs.Sticking(), the material is qs.J2Plasticity.

    python3 bench/upsetting_j2.py --cells 12 --json upsetting.json
    python3 bench/upsetting_j2.py --element taylor-hood
    python3 bench/upsetting_j2.py --remesh 0.25 0.45
    python3 bench/upsetting_j2.py --ccx FOLDER/calculix/ccx

Each row, at a reduction of height in per cent, has the force (kN); with --ccx also the force of
CalculiX on as many squares, CAX8R (see bench/peers/upsetting_calculix.py; bench/peers/install.py
installs it), as far as its run came; the force without friction, π R² Y, and Siebel's estimate for
a friction factor of 1, π R² Y (1 + 2 R / (3 √3 h)), where Y = σ_Y + H ln(h₀/h), R is the radius of
a cylinder of the same volume and h the height of the whole billet; the billet's radius (mm) at half
height, the same of CalculiX, and the radius at which the billet leaves the die. The last entries
are the change of volume, and the relative energy error: the die's work, summed by the trapezoidal
rule, less the energy stored and dissipated.
"""

import argparse
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "peers"))

import upsetting_calculix
from machine import circumstances, write
from upsetting_scene import ELEMENTS, HARDENING, HEIGHT, RADIUS, YIELD, Billet, create_mesh

REDUCTION = 0.6
KEYS = ("reduction", "force", "radius", "die_radius", "volume", "stored", "dissipated")


def run(cells, steps, element="mini", remesh=(), comm=MPI.COMM_WORLD, verbose=True):
    """Upset the billet.

    Args:
        cells: Number of squares along the radius of the first mesh.
        steps: Smallest number of steps.
        element: One of ELEMENTS.
        remesh: Reductions at which the billet is remeshed.
        comm: Communicator.
        verbose: Whether rank 0 prints the changes made by remeshing.

    Returns:
        The history, an array for each of KEYS, and of "iterations", those of Newton's method.
    """
    die = qs.RigidSurface.plane(comm, [0, HEIGHT], [0, -1])
    billet = Billet(create_mesh(comm, cells), die, element)
    rows = [(0.0, 0.0, RADIUS, RADIUS, billet.volume(), 0.0, 0.0, 0)]
    ends = [*sorted(remesh), REDUCTION]
    for k, end in enumerate(ends):
        start = rows[-1][0]
        if k > 0:
            billet = remeshed(billet, die, element, RADIUS / cells / 1.5, verbose)

        def drive(t, dt):
            die.displacement = [0, -HEIGHT * dt]

        # Time is the reduction. The first step is about as long as the billet stays elastic.
        dt = REDUCTION / steps
        stepper = qs.TimeStepper(billet.problem, min(dt, 0.003), drive, dt_max=dt, dt_min=1e-3 * dt)
        for t in stepper.run(end - start):
            billet.body.update()
            height = HEIGHT * (1 - start - t)
            measured = (billet.force(), *billet.radii(height), billet.volume())
            rows.append((start + t, *measured, *billet.energies(), stepper.num_iterations))
    return dict(zip((*KEYS, "iterations"), np.array(rows).T, strict=True))


def remeshed(old, die, element, size, verbose):
    """Return the billet with a new mesh."""
    new = qs.remesh(old.displacement(), size, axisymmetric=True)
    if verbose and old.mesh.comm.rank == 0:
        print(new.report)
    billet = Billet(new.mesh, die, element)
    billet.carry_from(old)
    return billet


def energy_error(history):
    """Return the error relative to the work so far; zero before any work is done."""
    force, way = history["force"], HEIGHT * history["reduction"]
    work = np.concatenate([[0], np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(way))])
    kept = history["stored"] + history["dissipated"]
    return (work - kept) / np.maximum(work, 1e-300)


def table(history, peer=None, reductions=np.arange(0.1, 0.61, 0.1)):
    """Return the rows at some reductions."""
    change = history["volume"] / history["volume"][0] - 1
    columns = {k: history[k] for k in ("force", "radius", "die_radius")}
    columns |= {"volume_change": change, "energy_error": energy_error(history)}
    rows = []
    for e in reductions:
        row = {"reduction": float(e)}
        row |= {k: float(np.interp(e, history["reduction"], v)) for k, v in columns.items()}
        flow, R = YIELD - HARDENING * np.log(1 - e), RADIUS / np.sqrt(1 - e)
        row["frictionless"] = np.pi * R**2 * flow
        row["siebel"] = row["frictionless"] * (1 + 2 * R / (3 * np.sqrt(3) * 2 * HEIGHT * (1 - e)))
        for k in ("force", "radius") if peer is not None else ():
            there = e <= peer["reduction"][-1] + 1e-9
            row[f"ccx_{k}"] = float(np.interp(e, peer["reduction"], peer[k])) if there else None
        rows.append(row)
    return rows


def show(rows):
    """Print the rows."""
    print(
        "    %    force      ccx   frictionless  Siebel   radius     ccx   at die   volume   energy"
    )
    for row in rows:
        ccx = [row.get(f"ccx_{k}") for k in ("force", "radius")]
        force = "-" if ccx[0] is None else f"{ccx[0] / 1e3:.1f}"
        radius = "-" if ccx[1] is None else f"{ccx[1]:.3f}"
        print(
            f"{100 * row['reduction']:5.0f} {row['force'] / 1e3:8.1f} {force:>8}"
            f" {row['frictionless'] / 1e3:10.1f} {row['siebel'] / 1e3:11.1f} {row['radius']:8.3f}"
            f" {radius:>7} {row['die_radius']:8.3f} {row['volume_change']:9.2%}"
            f" {row['energy_error']:8.2%}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--cells", type=int, default=8, help="cells along the radius")
    add("--steps", type=int, default=36)
    add("--element", choices=ELEMENTS, default="mini")
    add("--remesh", type=float, nargs="*", default=[], metavar="REDUCTION")
    add("--ccx", metavar="COMMAND", help="CalculiX, for a comparison")
    add("--json", metavar="FILE")
    p = parser.parse_args()
    comm = MPI.COMM_WORLD
    history = run(p.cells, p.steps, p.element, p.remesh)
    if comm.rank > 0:
        return
    peer = upsetting_calculix.run(p.ccx, p.cells) if p.ccx else None
    rows = table(history, peer)
    show(rows)
    print(f"{len(history['force']) - 1} steps, {history['iterations'].sum():.0f} Newton iterations")
    if peer is not None:
        reached = f"to {100 * peer['reduction'][-1]:.1f} %"
        print(f"CalculiX: penalty {peer['penalty']:g} MPa/mm, {reached}")
    if p.json:
        given = {"cells": p.cells, "element": p.element, "remesh": p.remesh}
        given |= {} if peer is None else {"ccx_penalty": peer["penalty"]}
        write(p.json, circumstances(comm.size) | given | {"rows": rows})


if __name__ == "__main__":
    main()
