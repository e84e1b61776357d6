"""Results of a contact after a solve: the object ``contact.results``."""

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

    All results are those of the last solve (or of the last step of a ``qs.TimeStepper``) until the
    next solve. Later changes of unknowns, tools, meshes, contact pairs (``contact.update``),
    penalty or multipliers (``contact.reset``) do not change them, and a failed solve does not
    either. Before the first solve, forces, tractions, multipliers and energies are zero, and gaps
    are those of the first contact detection.

    Each result is also an attribute of the contact: ``contact.slip()`` is
    ``contact.results.slip()``.
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

        The true distance between the facets, as deformed and moved at the last evaluation; the
        contact law uses :meth:`weighted_gap` instead. It is computed when this method is called, as
        in contact detection at nodes: to the nearest facet within the search radius that faces the
        node and is not occluded, or to the shape of a tool. Beside the boundary of a surface it is
        the distance to the plane of the nearest facet.

        Args:
            side: ``"slave"``, or ``"master"`` unless that is a rigid tool.

        Returns:
            Distances in the order of ``surface.node_x``, shape (nodes,); NaN where nothing is
            within the search distance. For tied contact the relative displacement, as
            :meth:`weighted_gap`.

        Raises:
            ValueError: If a deformed facet has no area, or the side is a rigid tool.
        """
        return results.gap(self._shown, side)

    def weighted_gap(self, side: str = "slave") -> Array:
        """Weighted gap ḡ (length, positive in penetration) at the nodes of this rank.

        The gap on which the multipliers act: a mean around each node. It may be closed where
        :meth:`gap` is not. With constraints at points it is the mean over the points around each
        node; this method is then collective, and so are :meth:`multiplier` and :meth:`active`.

        Args:
            side: Side that carries the multiplier; ``"master"`` with two multipliers only.

        Returns:
            Gaps in the order of ``surface.node_x``, shape (nodes,); for tied contact the relative
            displacement, shape (nodes, gdim). NaN where a node has no contact quadrature point, or,
            with an augmented Lagrangian, where hardly any of its area is covered by the other
            surface.
        """
        return results.weighted_gap(self._shown, side)

    def multiplier(self, side: str = "slave") -> Array:
        """Multiplier λ (stress) at the nodes of this rank, 0 where unpaired; of the shape of ḡ.

        λ enforces the contact; it is not the contact pressure. :meth:`traction` also includes the
        forces of vertices at sharp edges, which have multipliers of their own. These multipliers
        are not returned here.
        """
        return results.multiplier(self._shown, side)

    def memory(self, name: str, side: str = "slave") -> Array:
        """History variable of the law or friction law at the nodes of this rank, after a step.

        Args:
            name: A name in the ``memory`` of the law or the friction law, see :class:`qs.Law`.
            side: Side of the nodes.

        Returns:
            Values of shape (nodes,). With constraints at points, a node at a sharp edge has a value
            for each smooth patch of the surface; this is their mean. Vertices at sharp edges have
            history variables of their own, which are not returned here.

        Raises:
            ValueError: If neither law has a history variable of that name.
        """
        return results.memory(self._model, name, side)

    def active(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact, or have a point in contact, shape (nodes,).

        A slave node also counts as in contact if its multiplier belongs to a vertex or edge at a
        sharp edge (of a tool, too) that carries a force. Slave nodes on which such a vertex of a
        deformable master presses do not count. The contact areas of :meth:`shares` and
        :meth:`patch` do not include these vertices and edges. Nodes between nodes in contact also
        count if they are open by less than 1e-3 of a facet, as beside edges where the pressure is
        singular; their multiplier is 0. Grooves and dimples that are one or two nodes wide and
        equally flat count, too: use ``multiplier() > 0`` to exclude them. Collective.
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

        Displacement of the slave relative to the master while in contact, without the elastic part
        that the penalty allows; see :meth:`tangential_multiplier`.
        """
        return results.slip(self._shown, side)

    def slipping(self, side: str = "slave") -> npt.NDArray[np.bool_]:
        """Nodes of this rank that are in contact and slip, shape (nodes,).

        With constraints at points a node slips if more than half of its area in contact slips, see
        :meth:`shares`. Nodes also count as slipping if they carry only a part of the friction of a
        law whose friction jumps to zero when a node opens, or have lost it. Nodes between nodes in
        contact (see :meth:`active`) count if most of their neighbours slip. Without friction no
        node slips. Collective.
        """
        return results.slipping(self._shown, side)

    def shares(self, side: str = "slave") -> tuple[Array, Array]:
        """Parts, from 0 to 1, of the area S_k of each node of this rank in contact, and slipping.

        With constraints at points a part of a node may be in contact, and a part may slip; with
        constraints at nodes the values are 0 or 1. For ``closed, slips = contact.shares()`` the
        sticking part is ``closed - slips``. A part that has left contact within the step may have
        slipped before. Collective.

        Returns:
            The part in contact and the part that slips, shape (nodes,) each.
        """
        return results.shares(self._shown, side)

    def dissipation(self, side: str = "slave") -> Array:
        """Energy dissipated by friction at each node of this rank in the last step, (nodes,)."""
        return results.dissipation(self._shown, side)

    # --- Totals

    def penetration(self) -> float:
        """Depth (length) of the deepest point of either side in the other one. Collective.

        The true depth, measured as :meth:`gap`: at the nodes of both sides, and on the overlay also
        at points of its segments; 0 if nothing penetrates. Points beside the other surface do not
        count: a surface must contain every side of its body that the other body can hang over. On
        meshes of degree 2, the depths at the points are those of the curved surfaces. For tied
        contact it is the largest relative displacement.

        Raises:
            ValueError: If a deformed facet has no area.
        """
        return results.penetration(self._shown)

    def weighted_penetration(self) -> float:
        """Largest weighted gap (length) of the slave, 0 if all gaps are open. Collective.

        For tied contact the largest size of the relative displacement.
        """
        return results.weighted_penetration(self._shown)

    def stored_energy(self) -> float:
        """Energy Φ of the gaps at the last evaluation, over all ranks. Collective.

        With an augmented Lagrangian it is the energy of the augmented Lagrangian.
        """
        return results.energy(self._shown)

    def step_dissipation(self) -> float:
        """Energy dissipated by friction in the last step. Collective."""
        return results.step_dissipation(self._shown)

    def dissipated_energy(self) -> float:
        """Energy dissipated by friction in all finished steps. Collective."""
        friction = self._model.friction
        return 0.0 if friction is None else friction.dissipated_energy()

    def patch(self) -> tuple[float, float]:
        """Contact area and radius at the last evaluation. Collective.

        Returns:
            Area (2D: length) of the slave's nodes in contact (see :meth:`active`), Σ S_k, or of its
            points in contact, Σ w_p, with the areas of :meth:`traction`; and the radius of a disc
            of this area (2D: half the length). The error at the edge of contact is about half a
            facet. Grooves and dimples one or two nodes wide that are open by less than 1e-3 of a
            facet count as contact.
        """
        return results.patch(self._shown)

    def force(self, side: str) -> Array:
        """Total contact force on the body of one side, shape (gdim,). Collective.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return results.force(self._shown, side)

    def flow(self, side: str) -> float:
        """Total flow of a scalar field, such as heat per time, into one side's body. Collective.

        It includes the heat of friction.

        Args:
            side: ``"slave"`` or ``"master"``.

        Raises:
            ValueError: If it is a contact of displacements or velocities.
        """
        return results.flow(self._shown, side)

    def flux(self, side: str) -> fem.Function:
        """Recovered flow per area of a scalar field into the body of one side. Collective.

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

        Forces act where contact was detected, because their normals belong to these positions: all
        forces on a frictionless round tool go through its axis. The moments on two bodies balance.
        The exception are ties and friction across a gap: there the sum of the two moments is the
        length of the gap times the force along the surface. With ``sliding="finite"`` contact is
        detected at the present positions of the bodies. In the steps of a ``qs.TimeStepper``
        contact with velocity-based bodies is detected after the part θ of a step; forces on a rigid
        tool are then moved with its centre to the end of the step.

        Args:
            side: ``"slave"`` or ``"master"``.
            about: Reference point, shape (gdim,). By default the centre of a rigid tool (in time
                steps at the end of the step), or the origin.

        Returns:
            Moment, shape (3,), in 2D (1,).
        """
        return results.moment(self._shown, side, about)

    def traction(self, side: str, part: str = "whole") -> fem.Function:
        """Traction t (stress) recovered from the contact forces. Collective.

        Args:
            side: ``"slave"`` or ``"master"``: the traction that acts on this body.
            part: Part of the forces: ``"whole"``; ``"normal"``, the forces of the gaps; or
                ``"tangential"``, the forces of friction.

        Returns:
            Function of degree 1, zero off the surface; its nodal values on the surface are
            ``surface.node_values(traction)``. Its space is that of the surface (collapsed if that
            is a sub-space) if this space is Lagrange of degree 1. For P1 with bubbles and for
            degree 2 it is a new space of degree 1; the nodal forces f_k are then those conjugate to
            the new space.

            It is t_k = f_k / S_k; for a ring, its force over 2πr times a length. The area S_k is

            - of a displacement-based body in time steps: the area at the end of the step, so that
              t is present force per present area (the Cauchy traction);
            - in other solves with ``sliding="small"``: the area of the mesh at the last contact
              detection. The traction is then nominal, force per area of the mesh, as the stresses
              of small strains are;
            - with ``sliding="finite"``: the area at the end of the solve or step;
            - of a velocity-based body with small sliding: the area of the mesh on which it was
              solved, in time steps the mesh after the part ``theta`` of the step.

            It does not depend on the degree of displacements.
        """
        return results.traction(self._shown, side, part)

    def pressure(self, side: str) -> fem.Function:
        """Contact pressure p = −t·n (stress), positive in compression. Collective.

        t is the :meth:`traction` without friction, and n are the outward normals at the side's
        vertices in the present position of its facets. At an edge n is the mean of the normals of
        the facets around it. Ties may pull: p < 0.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Scalar Lagrange function of degree 1, zero off the surface; its values at the nodes of
            the surface are ``surface.node_values(pressure)``, shape (nodes,). It refers to the same
            area as :meth:`traction`.

        Raises:
            ValueError: If the side is a rigid tool.
        """
        return results.pressure(self._shown, side)

    # --- Fields

    def status(self, side: str = "slave") -> fem.Function:
        """Status of each node: 0 unpaired, 1 open, 2 active or sticking, 3 slipping. Collective.

        The numbers are those of ``qs.Status``. On a side without multipliers (the master of
        master-slave and quasi-symmetric contact) nodes that receive a contact force are active.
        They are slipping if more than half of the opposite constraints slip. Before the first
        solve, an automatic penalty is not known: nothing is in contact, and all paired nodes are
        open.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Function of degree 1, zero off the surface.
        """
        return fields.status(self._shown, side)

    def gap_function(self, side: str = "slave") -> fem.Function:
        """Weighted gap as a Function. Collective.

        For tied contact it is the size of the relative displacement.

        Args:
            side: ``"slave"`` or ``"master"``. On a side without multipliers the value of a node is
                the mean of the other side's gap over the area opposite to the node.

        Returns:
            Function of degree 1 (length, positive in penetration), zero off the surface and where
            :meth:`status` is 0.
        """
        return fields.gap_function(self._shown, side)

    def field_sources(self, side: str = "slave") -> dict[str, typing.Callable[[], fem.Function]]:
        """Functions that return the current fields of :meth:`fields`, for :class:`qs.FieldWriter`.

        ``qs.FieldWriter("die.xdmf", mesh, {"u": u} | contact.field_sources("master"))`` writes all
        fields with their values at each time.

        Args:
            side: ``"slave"`` or ``"master"``.
        """
        return fields.sources(self._model, side)

    def fields(self, side: str = "slave") -> dict[str, fem.Function]:
        """Fields for visualisation: traction, pressure, gap and status. Collective.

        Args:
            side: ``"slave"`` or ``"master"``.

        Returns:
            Functions of degree 1, zero off the surface, for any space of the body: ``"traction"``
            (stress, a vector), ``"pressure"`` (stress), ``"gap"`` (length, the weighted gap, see
            :meth:`gap_function`) and ``"status"`` (0 unpaired, 1 open, 2 active, 3 slipping, see
            :meth:`status`). With friction also the parts of the traction, ``"normal_traction"`` and
            ``"tangential_traction"``, and on a side that carries multipliers ``"slip"`` (length, a
            vector).
        """
        return {name: source() for name, source in self.field_sources(side).items()}
