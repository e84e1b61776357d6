"""Stress in the fillet of a bracket: a fine corner, tied to coarse parts that do not match.

A steel bracket of two legs, 40 mm long, 8 mm thick and 16 mm wide, hangs on a bolt and carries 1 kN
at the end of its shelf. The corner with the fillet, of radius 4 mm, has cells of size --fine, the
parts beyond it have cells of size --coarse; `qs.Tied` joins the three parts. The same bracket in
one mesh of size --fine, solved by DOLFINx alone, shows the loss of accuracy and the savings of the
ties. Displacements are of degree 2; half of the width is modelled, and solved with MUMPS.

    python3 demos/engineering/bracket.py --plot bracket.png
    mpirun -n 2 python3 demos/engineering/bracket.py --fine 2

Keys of the JSON object, each also with _matching for the bracket in one mesh:

- peak (MPa): largest von Mises stress in the fillet, in the middle of the width;
- deflection (mm): mean deflection of the loaded end;
- dofs, seconds: number of dofs, and time to assemble and solve;

and concentration, peak over the stress of a beam; peak_error and deflection_error, relative to the
matching mesh; force_error, the error of the force through the tie to the shelf, relative to the
load.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx.fem.petsc import LinearProblem

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from bracket_bodies import LOAD, Part, beam_stress
from bracket_plot import draw
from common.command import Command, option, report
from common.limits import check
from common.measures import Clock

LIMITS = {"peak_error": 2e-2, "deflection_error": 1e-2, "force_error": 1e-6}
LU = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}


@dataclasses.dataclass
class Parameters:
    """Mesh sizes of a bracket in mm."""

    fine: float = option(1.0, "cell size of the corner, and of the matching mesh, mm")
    coarse: float = option(5.0, "cell size of the other parts, mm")


def tied(comm, p):
    """Solve for the bracket in three parts; return the parts and the tie to the shelf."""
    corner = Part(comm, "corner", p.fine)
    upright, shelf = (Part(comm, name, p.coarse) for name in ("upright", "shelf"))
    ties = [
        qs.Contact(slave.surface(axis), corner.surface(axis), law=qs.Tied())
        for slave, axis in ((upright, 2), (shelf, 0))
    ]
    parts = [corner, upright, shelf]
    F, u, bcs = ([getattr(part, name) for part in parts] for name in ("F", "u", "bcs"))
    qs.ContactProblem(F, u, ties, bcs, linear_solver="direct").solve()
    return parts, ties[1]


def matching(comm, p):
    """Solve for the bracket in one mesh, without qsdolfinx."""
    whole = Part(comm, "whole", p.fine)
    a = ufl.derivative(whole.F, whole.u)
    LinearProblem(a, -whole.F, whole.bcs, u=whole.u, petsc_options=LU).solve()  # u is 0 in F
    return whole


def run(p, comm=MPI.COMM_WORLD):
    """Solve both ways; return the --json object, the parts, and the bracket in one mesh."""
    clock = Clock(comm)
    parts, tie = tied(comm, p)
    seconds, clock = clock.seconds(), Clock(comm)
    whole = matching(comm, p)
    seconds_matching = clock.seconds()
    peak, peak_matching = (max(part.fillet_stress()[1]) for part in (parts[0], whole))
    deflection, deflection_matching = parts[2].deflection(), whole.deflection()
    force = tie.force("slave")[[0, 2]]  # the symmetry plane also takes force along y
    result = {
        "peak": peak,
        "peak_matching": peak_matching,
        "peak_error": peak / peak_matching - 1,
        "concentration": peak / beam_stress(),
        "deflection": deflection,
        "deflection_matching": deflection_matching,
        "deflection_error": deflection / deflection_matching - 1,
        "force_error": np.linalg.norm(force - [0.0, LOAD / 2]) / (LOAD / 2),
        "dofs": sum(part.dofs for part in parts),
        "dofs_matching": whole.dofs,
        "seconds": seconds,
        "seconds_matching": seconds_matching,
    }
    return result, parts, whole


def main():
    p, a = Command(__doc__, Parameters, plot="draw the bracket, and its stress").parse()
    result, parts, whole = run(p)
    report(result, a.json, ".6g")
    check(result, LIMITS)
    if a.plot:
        draw(a.plot, result, parts, whole)


if __name__ == "__main__":
    main()
