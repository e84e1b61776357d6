"""What can be read from a contact after a solve."""

from __future__ import annotations

import abc
import contextlib
import math
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.checks import check_choice, check_vector
from qsdolfinx.base.collective import check_agreement, collective_errors
from qsdolfinx.friction.history import Tangential
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec, skew
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.traction import MASSES, nodal_forces, recover
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]

SIDES = ("slave", "master")
PARTS = ("whole", "normal", "tangential")
TWO_PASSES = ("double-pass", "two-half-pass")


class ContactResults(abc.ABC):
    """Gaps, multipliers, forces and tractions at the last evaluation; the base of Contact."""

    slave: Surface
    master: Surface | RigidSurface
    formulation: str
    passes: list[WeightedGap]
    #: Friction, None without.
    tangential: Tangential | None

    @property
    def slips(self) -> list[Slip]:
        """Slips of the passes; none without friction."""
        return [] if self.tangential is None else self.tangential.slips

    @property
    @abc.abstractmethod
    def unknown(self) -> tuple[str, str]:
        """``"displacement"`` or ``"velocity"``, of the slave's and of the master's body."""

    @property
    @abc.abstractmethod
    def dt(self) -> float | None:
        """Δt, time; None if there is none."""

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the surfaces."""
        return self.slave.comm

    @property
    @abc.abstractmethod
    def eps(self) -> float:
        """The penalty as a number."""

    @abc.abstractmethod
    def slope(self, p: WeightedGap) -> Array:
        """∂λ/∂ḡ at the rows of a pass."""

    def gap(self, side: str = "slave") -> Array:
        """Weighted gap ḡ (length, positive in penetration) at the nodes of this rank.

        Args:
            side: Side that carries the multiplier; ``"master"`` with two multipliers only.

        Returns:
            In the order of ``surface.node_x``, shape (nodes,), for tied contact the jump, (nodes,
            gdim). NaN where a node has no pairing point.
        """
        p = self._pass_of(side)
        return typing.cast(Array, _flat(p.on_nodes(p.values, math.nan)))

    def penetration(self) -> float:
        """Largest gap (length) of the slave, 0 if all are open; of a tied one its size.

        Collective.
        """
        gaps = self.gap()
        gaps = np.abs(gaps) if gaps.ndim == 2 else gaps
        local = float(np.max(gaps[np.isfinite(gaps)], initial=0.0))
        return float(self.comm.allreduce(local, op=MPI.MAX))

    def multiplier(self, side: str = "slave") -> Array:
        """Multiplier λ (stress) at the nodes of this rank, 0 where unpaired; shaped as the gap.

        λ is what enforces the contact, not the contact pressure: see :meth:`traction`.
        """
        p = self._pass_of(side)
        return typing.cast(Array, _flat(p.on_nodes(p.multiplier(self.eps), 0.0)))

    def active(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact, shape (nodes,)."""
        p = self._pass_of(side)
        return typing.cast(npt.NDArray[np.bool_], p.on_nodes(self.slope(p) > 0, False))

    @property
    def energy(self) -> float:
        """Energy Φ of the gaps at the last evaluation; of the augmented Lagrangian if that is used.

        Two-half-pass contact has no energy: this is then the sum of what its halves would have.
        Collective.
        """
        local = sum(p.energy(self.eps) for p in self.passes)
        return float(self.comm.allreduce(local, op=MPI.SUM))

    # --- Friction

    def tangential_multiplier(self, side: str = "slave") -> Array:
        """τ (stress) at the nodes of this rank, (nodes, gdim); friction on the slave is −τ.

        Args:
            side: As for :meth:`gap`.

        Raises:
            ValueError: If the contact has no friction.
        """
        slip = self._slips_of(side)
        return np.asarray(slip.gap.on_nodes(slip.response.traction, 0.0), dtype=np.float64)

    def slip(self, side: str = "slave") -> Array:
        """Slip (length) over all steps at the nodes of this rank, shape (nodes, gdim).

        Displacement of the slave against the master while in contact, less what is elastic with
        the penalty; see :meth:`tangential_multiplier`.
        """
        self._slips_of(side)
        assert self.tangential is not None
        return self.tangential.slip(0 if side == "slave" else 1)

    def slipping(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact and slip, shape (nodes,).

        Among them are nodes that have lost the friction of a law that jumps when they open.
        """
        slip = self._slips_of(side)
        return np.asarray(slip.gap.on_nodes(slip.slipping, False), dtype=bool)

    def dissipation(self, side: str = "slave") -> Array:
        """Energy that friction took at each node of this rank in the last step, shape (nodes,).

        0 after contact has paired anew.
        """
        slip = self._slips_of(side)
        return np.asarray(slip.gap.on_nodes(slip.dissipation(), 0.0), dtype=np.float64)

    def step_dissipation(self) -> float:
        """Energy that friction took in the last step. Collective."""
        local = sum(float(slip.dissipation().sum()) for slip in self.slips)
        return float(self.comm.allreduce(local, op=MPI.SUM))

    def dissipated_energy(self) -> float:
        """Energy that friction has taken in all steps that have ended. Collective."""
        return 0.0 if self.tangential is None else self.tangential.dissipated_energy()

    def _slips_of(self, side: str) -> Slip:
        p = self._pass_of(side)
        if not self.slips:
            raise ValueError("friction: this contact has none")
        return self.slips[self.passes.index(p)]

    # --- Forces

    def patch(self) -> tuple[float, float]:
        """Size of the contact at the last evaluation. Collective.

        Returns:
            Area of the closed slave nodes, Σ S_k (2D: length), and the radius of a disc of this
            area (2D: half the length). Known to about half a facet at the rim.
        """
        area = float(np.sum(self.slave.node_area[self.active()]))
        area = float(self.comm.allreduce(area, op=MPI.SUM))
        return area, area / 2 if self.slave.area_dim == 1 else math.sqrt(area / math.pi)

    def force(self, side: str) -> Array:
        """Total contact force on the body of one side, shape (gdim,). Collective.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        surface = self._agreed(side)
        if isinstance(surface, RigidSurface):
            return -self.force("slave")
        with self._force_vec(side) as vec:
            owned = nodal_forces(surface, vec).sum(axis=0)
        return np.asarray(surface.comm.allreduce(owned, op=MPI.SUM))

    def moment(self, side: str, about: npt.ArrayLike | None = None) -> Array:
        """Total moment of the contact forces on the body of one side. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.
            about: Point, shape (gdim,); by default the centre of a rigid tool, or the origin.

        Returns:
            Shape (3,), in 2D (1,).
        """
        surface = self._agreed(side)
        gdim = self.slave.gdim
        if about is None:
            about = self.master.center if isinstance(self.master, RigidSurface) else np.zeros(gdim)
        with collective_errors(self.comm):
            point = check_vector("about", about, gdim)
        check_agreement(self.comm, about=point.tolist())
        if isinstance(surface, RigidSurface):
            return -self.moment("slave", point)
        out = []
        with self._force_vec(side) as vec:
            for axis in np.eye(1 if gdim == 2 else 3):
                A = skew(axis)  # the forces' work in a small rotation
                field = affine_vec(surface, Affine(A, -A @ point))
                out.append(field.dot(vec))
                field.destroy()
        return np.array(out)

    def traction(self, side: str, mass: str = "lumped", part: str = "whole") -> fem.Function:
        """Traction t (stress) recovered from the contact forces. Collective.

        Args:
            side: ``"slave"`` or ``"master"``: the traction that acts on this body.
            mass: ``"lumped"``: t_k = f_k / S_k; ``"consistent"``: the function of degree 1 that
                does the work of the forces, M t = f with M_kl = ∫ N_k N_l ds.
            part: Of the forces: ``"whole"``, those of the gaps, ``"normal"``, or those of friction,
                ``"tangential"``.

        Returns:
            Function of degree 1, zero off the surface. Its space is that of the surface, collapsed
            if that is a sub-space; for displacements of degree 2 a new one of degree 1, and the
            nodal forces f_k are then those conjugate to this space.
        """
        with collective_errors(self.comm):
            check_choice("mass", mass, MASSES)
            check_choice("part", part, PARTS)
        check_agreement(self.comm, mass=mass, part=part)
        surface = self._agreed(side)
        if isinstance(surface, RigidSurface):
            raise ValueError(
                "side: a rigid tool has no traction; what acts on it is minus that of the slave"
            )
        with self._force_vec(side, part) as vec:
            return recover(surface, vec, mass)

    @contextlib.contextmanager
    def _force_vec(self, side: str, part: str = "whole") -> typing.Iterator[PETSc.Vec]:
        """Contact forces on the unknowns of one side's body, of which the reverse is assembled."""
        master = self.master.create_vec() if isinstance(self.master, Surface) else None
        vecs = self.slave.create_vec(), master
        for p in self.passes if part != "tangential" else ():
            p.add_forces(p.multiplier(self.eps), vecs if p.slave is self.slave else vecs[::-1])
        for slip in self.slips if part != "normal" else ():
            slip.add_forces(vecs if slip.slave is self.slave else vecs[::-1])
        wanted = vecs[SIDES.index(side)]
        assert wanted is not None
        wanted.scale(-1)
        try:
            yield wanted
        finally:
            for vec in vecs:
                if vec is not None:
                    vec.destroy()

    def _agreed(self, side: str) -> Surface | RigidSurface:
        """The surface of one side, the same on all ranks. Collective."""
        with collective_errors(self.comm):
            surface = self._surface(side)
        check_agreement(self.comm, side=side)
        return surface

    def _surface(self, side: str) -> Surface | RigidSurface:
        if side not in SIDES:
            raise ValueError(f'side: must be "slave" or "master", not {side!r}')
        return self.slave if side == "slave" else self.master

    def _pass_of(self, side: str) -> WeightedGap:
        self._surface(side)
        if side == "slave":
            return self.passes[0]
        if self.formulation not in TWO_PASSES:
            raise ValueError(f"side: {self.formulation} contact has no multiplier on the master")
        return self.passes[1]


def _flat(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Drop the second axis of single-valued rows."""
    return values[:, 0] if values.shape[1] == 1 else values
