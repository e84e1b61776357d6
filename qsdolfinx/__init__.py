"""Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx.

The method is that of L. Fourment and S. Popa, *Quasi-symmetrical formulations for contact and
friction between deformable bodies: application to 3D forging* (2005); equation numbers in brackets,
as in (12), are the paper's.
"""

from qsdolfinx import compat, materials
from qsdolfinx.base.crash import end_all_ranks
from qsdolfinx.base.messages import ContactWarning
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.fields import Status
from qsdolfinx.contact.reach import ReachWarning
from qsdolfinx.contact.readings import ContactResults
from qsdolfinx.contact.report import ContactReport
from qsdolfinx.contact.settings import ContactSettings
from qsdolfinx.friction.laws import Coulomb, CoulombTresca, Friction, Norton, Sticking, Tresca
from qsdolfinx.gap.conductance import effusivity_share, rough_surfaces
from qsdolfinx.gap.laws import Conductance, Law, Tied, Unilateral
from qsdolfinx.output.fields import FieldWriter
from qsdolfinx.output.history import History
from qsdolfinx.pairing.points import Pairing
from qsdolfinx.plasticity import J2Plasticity
from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.remesh import Remeshed, RemeshReport, remesh
from qsdolfinx.remeshing.sizes import size_from_curvature, size_from_distance, size_from_field
from qsdolfinx.remeshing.transfer import transfer
from qsdolfinx.solve.continuation import solve_with_continuation
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.solve.snes import ConvergenceError
from qsdolfinx.solve.stabilisation import Stabilisation
from qsdolfinx.steps.hand_over import RemeshingReport
from qsdolfinx.steps.remeshing import Remeshing
from qsdolfinx.steps.restart import load_run, save_run
from qsdolfinx.steps.staggered import Staggered
from qsdolfinx.steps.step_log import Attempt, StepLog
from qsdolfinx.steps.step_row import step_row
from qsdolfinx.steps.stepper import StepError, TimeStepper
from qsdolfinx.steps.stored_mesh import load_meshes
from qsdolfinx.surface.repartition import repartition
from qsdolfinx.surface.surface import Surface
from qsdolfinx.system.equations import Equations
from qsdolfinx.tools import smooth
from qsdolfinx.tools.elevate import elevate
from qsdolfinx.tools.rigid_surface import RigidSurface

#: The only definition of the version; pyproject.toml reads it.
__version__ = "0.1.0"

__all__ = [
    "Attempt",
    "Conductance",
    "Contact",
    "ContactProblem",
    "ContactReport",
    "ContactResults",
    "ContactSettings",
    "ContactWarning",
    "ConvergenceError",
    "Coulomb",
    "CoulombTresca",
    "Equations",
    "FieldWriter",
    "Friction",
    "History",
    "J2Plasticity",
    "Law",
    "Norton",
    "Pairing",
    "ReachWarning",
    "RemeshError",
    "RemeshReport",
    "Remeshed",
    "Remeshing",
    "RemeshingReport",
    "RigidSurface",
    "Stabilisation",
    "Staggered",
    "Status",
    "StepError",
    "StepLog",
    "Sticking",
    "Surface",
    "Tied",
    "TimeStepper",
    "Tresca",
    "Unilateral",
    "compat",
    "effusivity_share",
    "elevate",
    "end_all_ranks",
    "load_meshes",
    "load_run",
    "materials",
    "remesh",
    "repartition",
    "rough_surfaces",
    "save_run",
    "size_from_curvature",
    "size_from_distance",
    "size_from_field",
    "smooth",
    "solve_with_continuation",
    "step_row",
    "transfer",
]
