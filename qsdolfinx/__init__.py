"""Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx.

The method is that of L. Fourment and S. Popa, *Quasi-symmetrical formulations for contact and
friction between deformable bodies: application to 3D forging* (2005); equation numbers in brackets,
as in (12), are the paper's.
"""

from qsdolfinx import compat, materials
from qsdolfinx.advice import ContactWarning
from qsdolfinx.balance import BalanceWarning
from qsdolfinx.contact import Contact
from qsdolfinx.continuation import solve_with_continuation
from qsdolfinx.crash import end_all_ranks
from qsdolfinx.friction import Coulomb, CoulombTresca, Friction, Norton, Sticking, Tresca
from qsdolfinx.history import History, step_row
from qsdolfinx.laws import Law, Tied, Unilateral
from qsdolfinx.output import FieldWriter
from qsdolfinx.pairing import Pairing
from qsdolfinx.problem import ContactProblem
from qsdolfinx.reach import ReachWarning
from qsdolfinx.report import ContactReport
from qsdolfinx.restart import load_run, save_run
from qsdolfinx.rigid_surface import RigidSurface
from qsdolfinx.solver import ConvergenceError
from qsdolfinx.status import Status
from qsdolfinx.stepper import StepError, TimeStepper
from qsdolfinx.surface import Surface

#: The one place of the version; pyproject.toml reads it here.
__version__ = "0.1.0"

end_all_ranks()

__all__ = [
    "BalanceWarning",
    "Contact",
    "ContactProblem",
    "ContactReport",
    "ContactWarning",
    "ConvergenceError",
    "Coulomb",
    "CoulombTresca",
    "FieldWriter",
    "Friction",
    "History",
    "Law",
    "Norton",
    "Pairing",
    "ReachWarning",
    "RigidSurface",
    "Status",
    "StepError",
    "Sticking",
    "Surface",
    "Tied",
    "TimeStepper",
    "Tresca",
    "Unilateral",
    "compat",
    "load_run",
    "materials",
    "save_run",
    "solve_with_continuation",
    "step_row",
]
