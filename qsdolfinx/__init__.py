"""Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx.

The method is that of L. Fourment and S. Popa, *Quasi-symmetrical formulations for contact and
friction between deformable bodies: application to 3D forging* (2005); equation numbers in brackets,
as in (12), are the paper's.
"""

from qsdolfinx import materials
from qsdolfinx.contact import Contact
from qsdolfinx.continuation import solve_with_continuation
from qsdolfinx.friction import Coulomb, CoulombTresca, Friction, Norton, Sticking, Tresca
from qsdolfinx.history import History, step_row
from qsdolfinx.laws import Law, Tied, Unilateral
from qsdolfinx.output import FieldWriter
from qsdolfinx.pairing import Pairing
from qsdolfinx.problem import ContactProblem
from qsdolfinx.restart import load_run, save_run
from qsdolfinx.rigid_surface import RigidSurface
from qsdolfinx.solver import ConvergenceError
from qsdolfinx.stepper import StepError, TimeStepper
from qsdolfinx.surface import Surface

__all__ = [
    "Contact",
    "ContactProblem",
    "ConvergenceError",
    "Coulomb",
    "CoulombTresca",
    "FieldWriter",
    "Friction",
    "History",
    "Law",
    "Norton",
    "Pairing",
    "RigidSurface",
    "StepError",
    "Sticking",
    "Surface",
    "Tied",
    "TimeStepper",
    "Tresca",
    "Unilateral",
    "load_run",
    "materials",
    "save_run",
    "solve_with_continuation",
    "step_row",
]
