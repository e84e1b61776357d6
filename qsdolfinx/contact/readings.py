"""What is read of a contact after a solve: the object ``contact.results``."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.contact import fields, results
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.shown import shown

Array = npt.NDArray[np.float64]


class ContactResults:
    """Forces, tractions, gaps, multipliers and energies of a contact: ``contact.results``.

    All are those of the last solve (or of the last step of a ``qs.TimeStepper``) until the next
    one, whatever is changed since: unknowns, tools, meshes, pairs by ``contact.update``, penalty,
    multipliers by ``contact.reset``; also after a solve that fails. Before the first solve forces,
    tractions, multipliers and energies are zero, and gaps those of the surfaces as they were
    paired.

    Each can also be asked of the contact itself: ``contact.slip()`` is ``contact.results.slip()``.
    """

    def __init__(self, model: ContactModel) -> None:
        self._model = model

    # --- At nodes

    @property
    def _shown(self) -> ContactModel:
        """What there is to read: the last solve, whatever has been changed since."""
        return shown(self._model)

    def gap(self, side: str = "slave") -> Array:
        """Signed distance (length, positive in penetration) of this rank's nodes. Collective.

        The true one, between the facets as the last evaluation has deformed and moved them; see
        :meth:`weighted_gap` for what the law of contact sees. It is measured when it is asked for,
        as when pairing at nodes: to the nearest facet within the search radius that faces the node
        and is not hidden, or to the shape of a tool; beside a rim to the plane of the facet there.

        Args:
            side: ``"slave"``, or ``"master"`` unless that is a rigid tool.

        Returns:
            In the order of ``surface.node_x``, shape (nodes,), NaN where nothing is in reach. For
            tied contact the jump, which is :meth:`weighted_gap`.

        Raises:
            ValueError: If a deformed facet has no area, or the side is a rigid tool.
        """
        return results.gap(self._shown, side)

    def weighted_gap(self, side: str = "slave") -> Array:
        """Weighted gap ḡ (length, positive in penetration) at the nodes of this rank.

        What the multipliers act on: a mean around each node, which may be closed where
        :meth:`gap` is not. With constraints at points the mean over the points around each node,
        and collective, as are :meth:`multiplier` and :meth:`active`.

        Args:
            side: Side that carries the multiplier; ``"master"`` with two multipliers only.

        Returns:
            In the order of ``surface.node_x``, shape (nodes,), for tied contact the jump, (nodes,
            gdim). NaN where a node has no pairing point,
            or with an augmented Lagrangian hardly any of its area is covered.
        """
        return results.weighted_gap(self._shown, side)

    def multiplier(self, side: str = "slave") -> Array:
        """Multiplier λ (stress) at the nodes of this rank, 0 where unpaired; shaped as ḡ.

        λ is what enforces the contact, not the contact pressure: see :meth:`traction`, which also
        has the forces of vertices at creases; their multipliers are not among these.
        """
        return results.multiplier(self._shown, side)

    def memory(self, name: str, side: str = "slave") -> Array:
        """What a law that remembers has of the nodes of this rank since the last step, (nodes,).

        Args:
            name: One of ``law.memory``, see :class:`qs.Law`.
            side: Whose nodes.

        Raises:
            ValueError: If the law remembers nothing of that name.
        """
        return results.memory(self._model, name, side)

    def active(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact, or have a point that is, shape (nodes,).

        Nodes of the slave are whose multiplier vertices and edges at creases have, those of tools
        included, while they bear; what those of a deformable master press on is not. Areas of
        contact, as :meth:`shares` and :meth:`patch` have them, know nothing of such points.
        Among them are nodes that are open between closed ones by less than 1e-3 of a facet, as
        beside edges where the pressure is singular; their multiplier is 0. So are grooves and
        dimples one or two nodes wide that are as flat: ``multiplier() > 0`` leaves them out.
        Collective.
        """
        return results.active(self._shown, side)

    def tangential_multiplier(self, side: str = "slave") -> Array:
        """τ (stress) at the nodes of this rank, (nodes, gdim); friction on the slave is −τ.

        Args:
            side: As for :meth:`weighted_gap`.

        Raises:
            ValueError: If the contact has no friction.
        """
        return results.tangential_multiplier(self._shown, side)

    def slip(self, side: str = "slave") -> Array:
        """Slip (length) over all steps at the nodes of this rank, shape (nodes, gdim).

        Displacement of the slave against the master while in contact, less what is elastic with
        the penalty; see :meth:`tangential_multiplier`.
        """
        return results.slip(self._shown, side)

    def slipping(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact and slip, shape (nodes,).

        Among them are nodes that have a part of the friction of a law that jumps when they open, or
        have lost it, and those between closed ones (see :meth:`active`) if most of these slip; with
        constraints at points those of whose contact more than half slips, see :meth:`shares`. None
        without friction. Collective.
        """
        return results.slipping(self._shown, side)

    def shares(self, side: str = "slave") -> tuple[Array, Array]:
        """Parts of the area S_k of each node of this rank that are in contact, and that slip.

        From 0 to 1. With constraints at points a node may be in contact, and slip, in part; at
        nodes it is or is not. ``closed - slips`` is what sticks; what has left within the step may
        have slipped. Collective.

        Returns:
            Shape (nodes,) each.
        """
        return results.shares(self._shown, side)

    def dissipation(self, side: str = "slave") -> Array:
        """Energy that friction took at each node of this rank in the last step, shape (nodes,)."""
        return results.dissipation(self._shown, side)

    # --- Totals

    def penetration(self) -> float:
        """Depth (length) of the deepest point of either side in the other one. Collective.

        The true one, measured as :meth:`gap` is: at the nodes of both sides, on the overlay also
        at points of its pieces; 0 if nothing penetrates. What is beside the other side does not
        count. With smoothing, depths are those of the curved surfaces at the points. Of a tied
        contact it is the largest jump.

        Raises:
            ValueError: If a deformed facet has no area.
        """
        return results.penetration(self._shown)

    def weighted_penetration(self) -> float:
        """Largest weighted gap (length) of the slave, 0 if all are open; of a tied one its size.

        Collective.
        """
        return results.weighted_penetration(self._shown)

    def stored_energy(self) -> float:
        """Energy Φ of the gaps at the last evaluation; of the augmented Lagrangian if that is used.

        Over all ranks. Collective.
        """
        return results.energy(self._shown)

    def step_dissipation(self) -> float:
        """Energy that friction took in the last step. Collective."""
        return results.step_dissipation(self._shown)

    def dissipated_energy(self) -> float:
        """Energy that friction has taken in all steps that have ended. Collective."""
        friction = self._model.friction
        return 0.0 if friction is None else friction.dissipated_energy()

    def patch(self) -> tuple[float, float]:
        """Size of the contact at the last evaluation. Collective.

        Returns:
            Area of the slave's nodes in contact (see :meth:`active`), Σ S_k, or points, Σ w_p (2D:
            length), those that :meth:`traction` stands for; and the radius of a disc of this area
            (2D: half the length).
            Known to about half a facet at the rim; grooves and dimples one or two nodes wide that
            are open by less than 1e-3 of a facet count as contact.
        """
        return results.patch(self._shown)

    def force(self, side: str) -> Array:
        """Total contact force on the body of one side, shape (gdim,). Collective.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return results.force(self._shown, side)

    def flow(self, side: str) -> float:
        """Of scalar fields: total flow, such as heat per time, into the body of one side.

        Heat of friction is part of it. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Raises:
            ValueError: If it is a contact of displacements or velocities.
        """
        return results.flow(self._shown, side)

    def flux(self, side: str) -> fem.Function:
        """Of scalar fields: flow per area into the body of one side, recovered. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, f_k / S_k of the flows f_k at the nodes; 0 off the surface.

        Raises:
            ValueError: If it is a contact of displacements, or the side is a rigid tool.
        """
        return results.flux(self._shown, side)

    def moment(self, side: str, about: npt.ArrayLike | None = None) -> Array:
        """Total moment of the contact forces on the body of one side. Collective.

        Forces act where contact was detected, the places that their normals belong to: all of a
        frictionless round tool go through its axis, and those of two bodies balance, unless they
        are tied, or have friction, across a gap: by its length times the force along it. With
        ``sliding="finite"`` that is where the bodies are. In the steps of a ``qs.TimeStepper``
        contact with bodies in velocities is detected after the part θ of a step; forces on a rigid
        tool then go along with its centre to the end of the step.

        Args:
            side: ``"slave"`` or ``"master"``.
            about: Point, shape (gdim,); by default the centre of a rigid tool, in time steps at the
                end of the step, or the origin.

        Returns:
            Shape (3,), in 2D (1,).
        """
        return results.moment(self._shown, side, about)

    def traction(self, side: str, part: str = "whole") -> fem.Function:
        """Traction t (stress) recovered from the contact forces. Collective.

        Args:
            side: ``"slave"`` or ``"master"``: the traction that acts on this body.
            part: Of the forces: ``"whole"``, those of the gaps, ``"normal"``, or those of friction,
                ``"tangential"``.

        Returns:
            Function of degree 1, zero off the surface; its values there are
            ``surface.node_values(traction)``. Its space is that of the surface, collapsed if that
            is a sub-space, if it is Lagrange of degree 1. Else it is a new one: for P1 with bubbles
            and for degree 2, of which nodal forces f_k are then those conjugate to this space.

            It is t_k = f_k / S_k, of a ring the force on it over 2πr times a length. The area S_k:

            - of a body in displacements in time steps, where it is at the end of the step: present
              force per present area (Cauchy's traction);
            - in other solves with ``sliding="small"``, that of the mesh when contact was
              paired. The traction is nominal then, force per area of the mesh, as the stresses of
              small strains are;
            - with ``sliding="finite"``: where the body is at the end of the solve or step;
            - of a body in velocities with small sliding: of the mesh that it was solved for on, in
              time steps that after the part ``theta`` of the step.

            It does not depend on the degree of displacements.
        """
        return results.traction(self._shown, side, part)

    def pressure(self, side: str) -> fem.Function:
        """Contact pressure p = −t·n (stress), positive where bodies press each other. Collective.

        Of :meth:`traction` without friction, along the outward normals n of the side's vertices
        where its facets are; at an edge that is a mean of those around. Ties may pull: p < 0.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Scalar Lagrange function of degree 1, zero off the surface; at its nodes
            ``surface.node_values(pressure)``, shape (nodes,). Per the area that :meth:`traction`
            is of.

        Raises:
            ValueError: If the side is a rigid tool.
        """
        return results.pressure(self._shown, side)

    # --- Fields

    def status(self, side: str = "slave") -> fem.Function:
        """Status of each node: 0 unpaired, 1 open, 2 active or sticking, 3 slipping. Collective.

        The numbers are those of ``qs.Status``. On a side without multipliers, the master of
        master-slave and quasi-symmetric contact, nodes that a force reaches are active, and
        slipping if more than half of what they face slips. As long as an automatic penalty is not
        known, before the first solve, nothing is in contact and all paired nodes are open.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, zero off the surface.
        """
        return fields.status(self._shown, side)

    def gap_function(self, side: str = "slave") -> fem.Function:
        """The weighted gap as a Function; of tied contact the size of the jump. Collective.

        Args:
            side: ``"slave"`` or ``"master"``. On a side without multipliers it is the mean of the
                other side's gap over what a node faces.

        Returns:
            Function of degree 1 (length, positive in penetration), zero off the surface and where
            :meth:`status` is 0.
        """
        return fields.gap_function(self._shown, side)

    def field_sources(self, side: str = "slave") -> dict[str, typing.Callable[[], fem.Function]]:
        """Functions that return the fields of :meth:`fields` anew, for :class:`qs.FieldWriter`.

        ``qs.FieldWriter("die.xdmf", mesh, {"u": u} | contact.field_sources("master"))`` writes them
        all, as they are at each time.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return fields.sources(self._model, side)

    def fields(self, side: str = "slave") -> dict[str, fem.Function]:
        """Fields to look at: traction, pressure, gap and status. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Functions of degree 1, zero off the surface, whatever the space of the body:
            ``"traction"`` (stress, a vector), ``"pressure"`` (stress), ``"gap"`` (length, the
            weighted one, see :meth:`gap_function`) and ``"status"`` (0 unpaired, 1 open, 2 active,
            3 slipping, see :meth:`status`). With friction also the parts of the traction,
            ``"normal_traction"`` and ``"tangential_traction"``, and on a side that carries
            multipliers ``"slip"`` (length, a vector).
        """
        return {name: source() for name, source in self.field_sources(side).items()}
