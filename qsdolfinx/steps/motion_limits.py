"""Limits of rotation and slip of contact surfaces in one step."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.handles import handle_of
from qsdolfinx.contact import active_set
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.crossing import displacements_since
from qsdolfinx.contact.depth import SIDES
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place, Placement
from qsdolfinx.surface.affine import trace_vec
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class MotionLimits:
    """Check whether a step rotates or slips too far.

    Args:
        contacts: The contacts.
        max_rotation: Largest rotation of tools and of surface normals (radians); None for no limit.
        max_slip: Largest slip of active nodes along the other surface, over the largest facet at
            the node; None for no limit.
    """

    def __init__(
        self,
        contacts: typing.Sequence[Contact],
        max_rotation: float | None,
        max_slip: float | None,
    ) -> None:
        self._contacts = contacts
        self.max_rotation, self.max_slip = max_rotation, max_slip

    def fault_of(self, tools: typing.Sequence[RigidSurface]) -> str | None:
        """Describe what is wrong with the prescribed motion of tools, before it is made."""
        if self.max_rotation is None:
            return None
        most = max((float(np.linalg.norm(tool.rotation)) for tool in tools), default=0.0)
        return self._turned("a tool", most)

    def fault(self, starts: typing.Sequence[Placement]) -> str | None:
        """Describe what is wrong with the motion at the last evaluation; else None. Collective.

        Args:
            starts: Positions of the surfaces at the start of the step.
        """
        for contact, start in zip(self._contacts, starts, strict=True):
            now = contact.model.placement
            if self.max_rotation is not None:
                # Tools are checked by their own rotation.
                both = zip(SIDES, start.bodies, now.bodies, strict=False)
                for side, *places in both:
                    text = self._turned(f"the {side}'s surface", _turn(contact.comm, *places))
                    if text is not None:
                        return text
            if self.max_slip is not None and contact.model.has_gaps:
                slipped = _slip(contact.model, start)
                if slipped > self.max_slip:
                    return f"a slip of {slipped:.3g} facets, above max_slip = {self.max_slip:g}"
        return None

    def _turned(self, what: str, angle: float) -> str | None:
        if self.max_rotation is None or angle <= self.max_rotation * (1 + 1e-9):
            return None
        return f"{what} turns by {angle:.3g}, above max_rotation = {self.max_rotation:g}"


def _turn(comm: MPI.Intracomm, before: Place, now: Place) -> float:
    """Largest rotation angle (radians) of nodal normals. Collective."""
    normals = [place.facets().node_normal for place in (before, now)]
    cosine = np.clip(np.sum(normals[0] * normals[1], axis=1), -1.0, 1.0)
    sine = np.linalg.norm(np.cross(normals[0], normals[1]), axis=1)
    return float(comm.allreduce(np.max(np.arctan2(sine, cosine), initial=0.0), op=MPI.MAX))


def _slip(model: ContactModel, start: Placement) -> float:
    """Largest slip of active nodes, or of points with updated geometry, in facets. Collective."""
    if model.gaps[0].cut is not None:
        return _slip_at_points(model, start)
    gap, slave, gdim = model.gaps[0], model.slave, model.slave.gdim
    closed = gap.rows.largest_on_nodes(active_set.closed(model, gap).astype(np.float64)) > 0
    moved = zip(model.bodies, displacements_since(model, start), strict=True)
    vecs = [trace_vec(surface, np.ascontiguousarray(way[..., :gdim])) for surface, way in moved]
    by_node = gap.by_node()
    operator = by_node.jump_operator()
    jump = operator.apply(vecs[0].handle, handle_of(vecs[1] if len(vecs) > 1 else None))
    for vec in vecs:
        vec.destroy()
    normal = by_node.operator.slave_sum[:, :gdim]
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    cover = np.maximum(np.abs(operator.slave_sum[:, :1]), 1e-300)
    mean = jump.reshape(len(cover), gdim) / cover
    along = mean - np.sum(mean * normal, axis=1, keepdims=True) * normal
    node = np.asarray(by_node.operator.row_node)
    sizes = np.asarray(slave.cpp_object.node_facet_size)[node]
    share = np.linalg.norm(along, axis=1) / sizes * closed[node]
    return float(model.comm.allreduce(np.max(share, initial=0.0), op=MPI.MAX))


def _slip_at_points(model: ContactModel, start: Placement) -> float:
    gap = model.gaps[0]
    assert gap.following is not None and gap.cut is not None
    found = gap.slip_at_points((start.slave.positions(), start.master.positions()))
    sizes = gap.following.facet_sizes(gap.cut)
    count = len(sizes)  # the last constraints are not at points
    way = found.arc[:count] * np.linalg.norm(found.slip[:count], axis=1)
    share = way / sizes * active_set.closed(model, gap)[:count]
    return float(model.comm.allreduce(np.max(share, initial=0.0), op=MPI.MAX))
