"""Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx.

The method is that of L. Fourment and S. Popa, *Quasi-symmetrical formulations for contact and
friction between deformable bodies: application to 3D forging* (2005); equation numbers in brackets,
as in (12), are the paper's.
"""

from qsdolfinx.contact import Contact
from qsdolfinx.laws import Law, Tied, Unilateral
from qsdolfinx.pairing import Pairing
from qsdolfinx.problem import ContactProblem
from qsdolfinx.rigid_surface import RigidSurface
from qsdolfinx.solver import ConvergenceError
from qsdolfinx.surface import Surface

__all__ = [
    "Contact",
    "ContactProblem",
    "ConvergenceError",
    "Law",
    "Pairing",
    "RigidSurface",
    "Surface",
    "Tied",
    "Unilateral",
]
