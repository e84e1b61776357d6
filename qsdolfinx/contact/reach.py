"""Surfaces that move further towards each other than contact has looked when it was paired."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.contact import Contact
from qsdolfinx.surface.affine import affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class ReachWarning(ContactWarning):
    """Nodes that were too far from the other surface to be paired may have passed through it."""


def check_reach(contact: Contact, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Warn if slave nodes without a partner may have met the other surface all the same.

    They were further from it than the search radius, or beside it. If the surfaces have approached
    each other by less, along their normals, none of the former can have met it. Collective.

    Args:
        contact: The contact, solved.
        slave: Unknowns of the slave's body as contact sees them.
        master: The same of the master's.
    """
    p = contact.passes[0]
    alone = np.setdiff1d(np.arange(len(contact.slave.node_area)), p.row_node)
    if contact.law.jump or contact.comm.allreduce(len(alone)) == 0:
        return
    parts = zip((slave, master), contact.scale, contact.offset, strict=True)
    moved = [None if x is None else (x, scale, offset) for x, scale, offset in parts]
    assert moved[0] is not None
    rise = _outwards(contact.slave, *moved[0])
    other: Array = np.zeros(0)
    if isinstance(contact.master, RigidSurface):
        field = affine_vec(contact.slave, contact.master.motion)
        np.subtract(rise, _outwards(contact.slave, field, 1.0, None), out=rise)
        field.destroy()
    else:
        assert moved[1] is not None
        other = _outwards(contact.master, *moved[1])
    highest = (float(np.max(x, initial=0.0)) for x in (rise[alone], other))
    approach = sum(contact.comm.allreduce(height, op=MPI.MAX) for height in highest)
    if approach > contact.search_radius:
        warn(
            "the surfaces have moved further towards each other than the search_radius of "
            f"{contact.search_radius:g}, within which alone nodes were paired: nodes without a "
            "partner may have passed through; give a larger search_radius, or make time steps, "
            "which pair anew",
            ReachWarning,
            stacklevel=2,
        )


def _outwards(surface: Surface, x: PETSc.Vec, scale: float, offset: PETSc.Vec | None) -> Array:
    """Displacements of the nodes along the outward normal."""
    at = surface.node_dofs - x.owner_range[0]
    u = scale * x.array_r[at]
    if offset is not None:
        u = u + offset.array_r[at]
    return np.asarray(np.sum(u * surface.node_normal[:, : surface.gdim], axis=1))
