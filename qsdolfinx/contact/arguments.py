"""What a contact cannot be made of."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from qsdolfinx.base.checks import check_positive
from qsdolfinx.friction.laws import Friction
from qsdolfinx.gap.laws import Law
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import RigidSurface


def check_surfaces(slave: Surface, master: Surface | RigidSurface) -> None:
    """Refuse surfaces that cannot be in contact."""
    if isinstance(slave, RigidSurface):
        raise TypeError("slave: must be a qsdolfinx.Surface; a rigid tool can be the master only")
    for name, surface in (("slave", slave), ("master", master)):
        if not isinstance(surface, Surface | RigidSurface):
            raise TypeError(f"{name}: must be a qsdolfinx.Surface, not {type(surface).__name__}")
    if slave.gdim != master.gdim:
        raise ValueError("slave and master have different geometric dimensions")
    if MPI.Comm.Compare(slave.comm, master.comm) not in (MPI.IDENT, MPI.CONGRUENT):
        raise ValueError("slave and master: the meshes must be on the same ranks in the same order")
    if isinstance(master, RigidSurface):
        return
    if slave.axisymmetric != master.axisymmetric:
        raise ValueError("slave and master: both or none must be axisymmetric")
    if slave.mesh is master.mesh and np.intersect1d(slave.facets, master.facets).size:
        raise ValueError("slave and master share facets: a facet cannot be in contact with itself")


def check_friction(friction: typing.Any, penalty: typing.Any, law: Law, slave: Surface) -> None:
    """Refuse friction of another type, of tied contact, or with parameters of another mesh."""
    if friction is None:
        if penalty is not None:
            raise ValueError("friction_penalty: needs friction")
        return
    if not isinstance(friction, Friction):
        raise TypeError(f"friction: must be such as qs.Coulomb(0.2), or None, not {friction!r}")
    if penalty is not None:
        check_positive("friction_penalty", penalty)
    if law.jump:
        raise ValueError("friction: tied contact sticks already; leave it out, or use Unilateral()")
    for name, value in friction.parameters.items():
        if isinstance(value, fem.Function) and value.function_space.mesh is not slave.mesh:
            raise ValueError(f"friction: {name}: the Function must be on the mesh of the slave")
