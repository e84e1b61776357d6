"""What a contact has to show on both bodies: status, gap and traction as Functions."""

from __future__ import annotations

import enum
import functools
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.results import TWO_PASSES, ContactResults
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.traction import nodal_forces
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]

#: Part of a node's area, or of what it faces, that may be rounding.
SOME = 1e-10


class Status(enum.IntEnum):
    """What a node does, the values of :meth:`ContactFields.status`."""

    #: No pairing point reaches it: it is off the surface, or too far from the other one.
    UNPAIRED = 0
    #: A gap is open.
    OPEN = 1
    #: In contact, and with friction sticking; a tied node.
    ACTIVE = 2
    #: In contact and slipping.
    SLIPPING = 3


class Faced(typing.NamedTuple):
    """Of a master's nodes: which a pairing point reaches, and the mean of values they face."""

    reached: npt.NDArray[np.bool_]
    mean: Array


def faced(p: WeightedGap, rows: Array) -> Faced:
    """Means over what the master's nodes of a pass face of values at its rows. Collective.

    For node l that is Σ_p w_p N_l(ζ_p) c(ξ_p) / Σ_p w_p N_l(ζ_p), which the transposed operator
    gives: nodes are where a multiplier's force would reach them.

    Args:
        p: The pass; its master is deformable.
        rows: Values c_k of the rows, shape (rows,).
    """
    assert isinstance(p.master, Surface)
    operator = p.operator
    if not p.law.jump:
        operator = _cpp.GapOperator(
            p.slave._cpp_object, p.master._cpp_object, p.points, jump=True, by_cover=p.by_cover
        )
    forces = np.zeros((len(rows), p.slave.gdim))
    forces[:, 0], forces[:, 1] = p.operator.row_area, p.operator.row_area * rows
    vecs = p.slave.create_vec(), p.master.create_vec()
    operator.add_transpose(forces, vecs[0].handle, vecs[1].handle, False)
    area, sums = -nodal_forces(p.master, vecs[1])[:, :2].T
    for vec in vecs:
        vec.destroy()
    reached = area > SOME * p.master.linear.node_area
    return Faced(reached, np.divide(sums, area, out=np.full_like(sums, np.nan), where=reached))


class ContactFields(ContactResults):
    """Results as Functions, on the side without multipliers too."""

    def status(self, side: str = "slave") -> fem.Function:
        """Status of each node: 0 unpaired, 1 open, 2 active or sticking, 3 slipping. Collective.

        The numbers are those of ``qs.Status``. On a side without multipliers, the master of
        master-slave and quasi-symmetric contact, nodes that a force reaches are active, and
        slipping if more than half of what they face slips.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, zero off the surface.
        """
        surface = self._deformable(side)
        return _scalar(surface, self._status(side, surface))

    def gap_function(self, side: str = "slave") -> fem.Function:
        """The weighted gap as a Function; of tied contact the size of the jump. Collective.

        Args:
            side: ``"slave"`` or ``"master"``. On a side without multipliers it is the mean of the
                other side's gap over what a node faces.

        Returns:
            Function of degree 1 (length, positive in penetration), zero off the surface and where
            :meth:`status` is 0.
        """
        surface = self._deformable(side)
        if self._has_multiplier(side):
            values = _sizes(self.gap(side))
        else:
            values = faced(self.passes[0], _sizes(self.passes[0].values)).mean
        return _scalar(surface, np.nan_to_num(values))

    def field_sources(self, side: str = "slave") -> dict[str, typing.Callable[[], fem.Function]]:
        """Functions that return the fields of :meth:`fields` anew, for :class:`qs.FieldWriter`.

        ``qs.FieldWriter("die.xdmf", mesh, {"u": u} | contact.field_sources("master"))`` writes them
        all, as they are at each time.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        self._deformable(side)
        sources: dict[str, typing.Callable[[], fem.Function]] = {
            "traction": functools.partial(self.traction, side),
            "gap": functools.partial(self.gap_function, side),
            "status": functools.partial(self.status, side),
        }
        if self.slips:
            for part in ("normal", "tangential"):
                sources[f"{part}_traction"] = functools.partial(self.traction, side, part=part)
            if self._has_multiplier(side):
                sources["slip"] = lambda: self._deformable(side).linear.function(self.slip(side))
        return sources

    def fields(self, side: str = "slave") -> dict[str, fem.Function]:
        """Fields to look at: traction, gap and status. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Functions of degree 1, zero off the surface: ``"traction"`` (stress, a vector),
            ``"gap"`` (length, positive in penetration, see :meth:`gap_function`) and ``"status"``
            (0 unpaired, 1 open, 2 active, 3 slipping, see :meth:`status`). With friction also its
            parts ``"normal_traction"`` and ``"tangential_traction"``, and on a side that carries
            multipliers ``"slip"`` (length, a vector).
        """
        return {name: source() for name, source in self.field_sources(side).items()}

    def _status(self, side: str, surface: Surface) -> Array:
        if self._has_multiplier(side):
            p = self._pass_of(side)
            paired = p.on_nodes(np.ones(len(p.row_node), dtype=bool), False)
            status = np.where(paired, Status.OPEN, Status.UNPAIRED)
            status = np.where(self.active(side), Status.ACTIVE, status)
            if self.slips:
                status = np.where(self.slipping(side), Status.SLIPPING, status)
            return status.astype(np.float64)
        p = self.passes[0]
        # An open gap may be at a node of which another row's force reaches a part.
        force = faced(p, (self.slope(p) > 0).astype(np.float64))
        status = np.where(force.reached, Status.OPEN, Status.UNPAIRED)
        active = force.mean > SOME  # not where it is NaN
        status = np.where(active, Status.ACTIVE, status)
        if self.slips:
            slip = faced(p, self.slips[0].slipping.astype(np.float64))
            status = np.where(active & (slip.mean > force.mean / 2), Status.SLIPPING, status)
        return status.astype(np.float64)

    def _has_multiplier(self, side: str) -> bool:
        return side == "slave" or self.formulation in TWO_PASSES

    def _deformable(self, side: str) -> Surface:
        """The surface of one side, the same on all ranks. Collective."""
        surface = self._agreed(side)
        if isinstance(surface, RigidSurface):
            raise ValueError("side: a rigid tool has no fields; see those of the slave")
        return surface


def _sizes(values: Array) -> Array:
    """Gaps as they are, jumps by their size."""
    if values.ndim == 1:
        return values
    return values[:, 0] if values.shape[1] == 1 else np.linalg.norm(values, axis=1)


def _scalar(surface: Surface, values: Array) -> fem.Function:
    """Function of degree 1 with these values at the nodes. Collective."""
    padded = np.zeros((len(values), surface.gdim))
    padded[:, 0] = values
    return surface.linear.function(padded).sub(0).collapse()
