"""Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx.

The method is that of L. Fourment and S. Popa, *Quasi-symmetrical formulations for contact and
friction between deformable bodies: application to 3D forging* (2005); equation numbers in brackets,
as in (12), are the paper's.
"""

from qsdolfinx import compat, materials
from qsdolfinx.base.messages import ContactWarning
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.fields import Status
from qsdolfinx.contact.reach import ReachWarning
from qsdolfinx.contact.report import ContactReport
from qsdolfinx.friction.laws import Coulomb, CoulombTresca, Friction, Norton, Sticking, Tresca
from qsdolfinx.gap.laws import Law, Tied, Unilateral
from qsdolfinx.output.fields import FieldWriter
from qsdolfinx.output.history import History
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.plasticity import J2Plasticity
from qsdolfinx.solve.continuation import solve_with_continuation
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.solve.snes import ConvergenceError
from qsdolfinx.solve.stabilisation import Stabilisation
from qsdolfinx.steps.restart import load_run, save_run
from qsdolfinx.steps.step_row import step_row
from qsdolfinx.steps.stepper import StepError, TimeStepper
from qsdolfinx.surface.repartition import repartition
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools import smooth
from qsdolfinx.tools.rigid_surface import RigidSurface

#: The one place of the version; pyproject.toml reads it here.
__version__ = "0.1.0"

__all__ = [
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
    "J2Plasticity",
    "Law",
    "Norton",
    "Pairing",
    "ReachWarning",
    "RigidSurface",
    "Stabilisation",
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
    "repartition",
    "save_run",
    "smooth",
    "solve_with_continuation",
    "step_row",
]
