"""Surfaces that move further towards each other than contact has looked when it was paired."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.surface.affine import affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import deformable

Array = npt.NDArray[np.float64]


class ReachWarning(ContactWarning):
    """Nodes that were too far from the other surface to be paired may have passed through it."""


def check_reach(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Warn if slave nodes without a partner may have met the other surface after all.

    They were further from it than the search radius, or beside it. If the surfaces have approached
    each other by less, along their normals, none of the former can have met it. Once for each
    contact. Collective.

    Args:
        model: The contact, solved.
        slave: Unknowns of the slave's body as contact sees them.
        master: The same of the master's.
    """
    if model.reach_warned:
        return
    p = model.gaps[0]
    alone = np.setdiff1d(np.arange(len(model.slave.node_area)), p.rows.reached)
    if model.law.jump or model.comm.allreduce(len(alone)) == 0:
        return
    parts = zip((slave, master), model.kinematics.scale, model.offset or (None, None), strict=True)
    moved = [None if x is None else (x, scale, offset) for x, scale, offset in parts]
    assert moved[0] is not None
    rise = _outwards(model.slave, *moved[0])
    other: Array = np.zeros(0)
    motion, master_surface = model.master.motion, deformable(model.master)
    if motion is not None:
        field = affine_vec(model.slave, motion)
        np.subtract(rise, _outwards(model.slave, field, 1.0, None), out=rise)
        field.destroy()
    if moved[1] is not None and master_surface is not None:
        other = _outwards(master_surface, *moved[1])
    towards = model.comm.allreduce(float(np.max(other, initial=0.0)), op=MPI.MAX)
    radius = model.settings.search_radius
    reach = _least_reach(model)[alone] if radius is None else np.full(len(alone), radius)
    beyond = np.maximum(rise[alone], 0.0) + towards - reach
    least = float(np.min(reach[beyond > 0], initial=np.inf))
    least = model.comm.allreduce(least, op=MPI.MIN)
    if np.isfinite(least):
        warn(
            "the surfaces have moved further towards each other than the search_radius of "
            f"{least:g}, within which alone nodes were paired: nodes without a "
            "partner may have passed through; give a larger search_radius, or make time steps, "
            "which pair anew",
            ReachWarning,
        )
        model.reach_warned = True


def _least_reach(model: ContactModel) -> Array:
    """The radius at the slave's nodes, whatever the master's facets are there."""
    if model.master.is_analytic:
        return np.full(len(model.slave.node_area), model.paired.search_radius)
    return np.asarray(model.slave.cpp_object.node_facet_size)


def _outwards(surface: Surface, x: PETSc.Vec, scale: float, offset: PETSc.Vec | None) -> Array:
    """Displacements of the nodes along the outward normal."""
    at = surface.node_dofs - x.owner_range[0]
    u = scale * x.array_r[at]
    if offset is not None:
        u = u + offset.array_r[at]
    return np.asarray(np.sum(u * surface.node_normal[:, : surface.gdim], axis=1))
