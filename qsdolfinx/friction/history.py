"""Friction of one contact: slips of its integration sides, and history from step to step."""

from __future__ import annotations

import functools
import typing
import warnings

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.messages import ContactWarning
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.friction.laws import Friction
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.traction import facet_measure

Array = npt.NDArray[np.float64]


#: Slip rate that counts as slow, over the largest slip rate. With much more, laws of the rate would
#: be too soft to resist; with rounding's size, they would jump where slip changes its direction.
SLOW = 1e-3

#: Factor by which a step has to be slower than the largest slip rate so far for a new rate: with 1,
#: the law would change in each step, and steps would be solved again for nothing.
SLOWER = 5.0


class FrictionState(typing.NamedTuple):
    """History of friction after a step; arrays are replaced, never written into.

    Attributes:
        slipped: See :class:`FrictionHistory`.
        rate: Largest slip rate.
        dissipated: Dissipated energy, this rank's part.
    """

    slipped: tuple[Array, ...]
    rate: float | None
    dissipated: float


class FrictionHistory:
    """Friction of a contact, with the data that are kept when the contact pairs are updated.

    Args:
        friction: The law.
        slave: Surface of the contact's slave.
        penalty: ε in tangential direction (stress per length); None for the ε of the gaps.
    """

    def __init__(self, friction: Friction, slave: Surface, penalty: float | None) -> None:
        self.law = friction
        self._slave = slave
        #: ε in tangential direction, as given.
        self.given_penalty = penalty
        #: Slip up to the end of the last step, at the nodes of the slave of each integration side,
        #: shape (nodes, gdim).
        self.slipped: list[Array] = []
        #: Largest slip rate (length per time) of the first step with slip, or of a later step in
        #: which all slip is much slower; None before, and for laws that need no rate.
        self.rate: float | None = None
        #: This rank's part of the energy dissipated by friction up to the end of the last step.
        self.dissipated = 0.0

    def slips_of(self, passes: typing.Sequence[WeightedGap]) -> tuple[Slip, ...]:
        """Slips of new integration sides, with the values of the law's parameters. Collective."""
        slips = tuple(Slip(p, self.law) for p in passes)
        # Before any solve, the number of sides changes if those of edges are removed.
        if len(self.slipped) != len(slips):
            self.slipped = [np.zeros((len(p.slave.node_area), p.slave.gdim)) for p in passes]
        for name, value in self.law.parameters.items():
            if isinstance(value, float):
                for slip in slips:
                    slip.of_nodes[name] = value
                    slip.parameters[name] = np.full(slip.gap.num_rows, value)
        self.read_parameters(slips)
        return slips

    def penalty(self, eps: float) -> float:
        """ε in tangential direction, for a given ε of the gaps."""
        return eps if self.given_penalty is None else self.given_penalty

    # --- State

    @property
    def state(self) -> FrictionState:
        """The history up to now, to be restored if a step fails."""
        return FrictionState(tuple(self.slipped), self.rate, self.dissipated)

    def restore(self, state: FrictionState) -> None:
        """Go back to an earlier state."""
        self.slipped = list(state.slipped)
        self.rate = state.rate
        self.dissipated = state.dissipated

    def reset(self, slips: typing.Sequence[Slip]) -> None:
        """Delete the history, also that of the slips. Collective."""
        self.slipped = [np.zeros_like(slipped) for slipped in self.slipped]
        self.rate, self.dissipated = None, 0.0
        for slip in slips:
            slip.reset()

    # --- Rates

    def continue_with(self, rate: float | None) -> None:
        """Use the slip rate of an earlier run."""
        self.rate = rate

    def slow(self, dt: float | None, facet_size: float) -> float | None:
        """Slip rate that counts as slow: a small part of the largest slip rate. None without Δt.

        Args:
            dt: Δt, time.
            facet_size: Size of the smallest facet, length. Until a rate is known, one facet size
                per Δt is used as the largest slip rate.
        """
        if dt is None:
            return None
        return SLOW * (facet_size / dt if self.rate is None else self.rate)

    def learn_rate(self, slips: typing.Sequence[Slip], dt: float | None, facet_size: float) -> bool:
        """Update the largest slip rate from a solution. Collective.

        The rate of the first step with slip is kept, so that the law does not change. It is
        replaced only if all slip of a solution is so much slower that the regularised law would be
        different there.

        Returns:
            Whether the rate has changed: the step has to be solved again. This ends, because each
            new rate is SLOWER times slower than the one before.
        """
        if dt is None or not self.law.needs_rate:
            return False
        fastest = max(slip.fastest() for slip in slips)
        way = float(self._slave.comm.allreduce(fastest, op=MPI.MAX))
        if way <= ROUNDING * facet_size:
            return False
        if self.rate is not None and way / dt > self.rate / SLOWER:
            return False
        self.rate = way / dt
        return True

    # --- Parameters

    def read_parameters(self, slips: typing.Sequence[Slip]) -> None:
        """Read the present values of the law's Constants and Functions. Collective.

        Raises:
            ValueError: If a Function or Constant is negative or not finite.
        """
        for name, value in self.law.parameters.items():
            if isinstance(value, float):
                continue
            if isinstance(value, fem.Constant):
                number = float(value.value)
                at_rows: list[Array] = [np.full(s.gap.num_rows, number) for s in slips]
                for slip in slips:
                    slip.of_nodes[name] = max(number, 0.0)
            else:
                at_rows = self._at_rows(self._means[name], slips)
                for slip in slips:
                    if slip.gap.following is not None:
                        slip.of_nodes[name] = np.maximum(self._at_nodes(self._means[name]), 0.0)
            with collective_errors(self._slave.comm):
                for values in at_rows:
                    if not (np.isfinite(values).all() and np.all(values >= -1e-12)):
                        raise ValueError(f"{name}: must be finite and not negative")
            for slip, values in zip(slips, at_rows, strict=True):
                slip.parameters[name] = np.maximum(values, 0)

    @functools.cached_property
    def _means(self) -> dict[str, fem.Form]:
        """For each Function f, the form of ∫ f N_k ds and, in a second component, of ∫ N_k ds."""
        linear = self._slave.linear
        v, zero = (
            ufl.TestFunction(linear.collapsed_space),
            0 * ufl.SpatialCoordinate(linear.mesh)[0],
        )
        forms = {}
        for name, value in self.law.parameters.items():
            if isinstance(value, fem.Function):
                components = [value, 1 + zero, zero][: linear.gdim]
                integrand = ufl.inner(ufl.as_vector(components), v)
                forms[name] = fem.form(integrand * facet_measure(linear))
        return forms

    def _at_rows(self, form: fem.Form, slips: typing.Sequence[Slip]) -> list[Array]:
        """Means with the weights N_k at the constraints of all integration sides. Collective."""
        values, out = self._at_nodes(form), []
        for slip in slips:
            if slip.gap.slave is self._slave:
                out.append(slip.gap.rows.from_nodes(values))
            else:
                out.append(self._on_other_side(values, slip))
        return out

    def _at_nodes(self, form: fem.Form) -> Array:
        """Means with the weights N_k at the slave's owned nodes. Collective."""
        linear = self._slave.linear
        b = fem.assemble_vector(form)
        b.scatter_reverse(la.InsertMode.add)
        integrals = fem.Function(linear.collapsed_space)
        integrals.x.array[:] = b.array
        means = linear.node_values(integrals)
        return np.asarray(means[:, 0] / means[:, 1])

    def _on_other_side(self, values: Array, slip: Slip) -> Array:
        """Means of values at the slave's nodes for constraints of the second integration side.

        They are means over the part of the slave that a constraint faces. Collective.
        """
        padded = np.zeros((len(values), self._slave.gdim))
        padded[:, 0], padded[:, 1] = values, 1.0
        faced, own = self._slave.nodal_vec(padded), slip.slave.create_vec()
        # The slave of the contact is the master of this side, whose part is negative.
        sums = -slip.operator.apply(own.handle, faced.handle)
        for vec in (faced, own):
            vec.destroy()
        return np.asarray(sums[:, 0] / sums[:, 1])

    # --- Steps

    def end_step(self, slips: typing.Sequence[Slip]) -> None:
        """Start the next step from the end of this one. Collective.

        Warns:
            ContactWarning: If a surface in contact has turned by more than 90°, or points have
                turned by more than 149°: the slip, which is a chord, may then point backwards.
        """
        turned = any([slip.has_turned for slip in slips])
        if self._slave.comm.allreduce(turned, op=MPI.LOR):
            warnings.warn(
                "sliding: a surface that slips has turned so far in a step that it is not known "
                "which way friction acts; take smaller steps",
                ContactWarning,
                stacklevel=2,
            )
        moving = [(i, slip) for i, slip in enumerate(slips) if not slip.state.ended]
        for _, slip in moving:  # first of all, since the law may raise an error
            slip.commit()
        for i, slip in moving:
            self.slipped[i] = self.slip(i, slip)
            self.dissipated += float(slip.dissipation().sum())
            slip.end_step()

    def slip(self, i: int, slip: Slip) -> Array:
        """Slip at the nodes of integration side i, in all earlier steps and the present step."""
        state = slip.state
        if state.ended:
            return self.slipped[i]
        rows, values = slip.gap.rows, slip.lost()[0]
        if isinstance(rows, PointRows):
            at_nodes = rows.means_of_some(values, state.closed)
        else:
            at_nodes = np.asarray(rows.on_nodes(values, 0.0), dtype=np.float64)
        return self.slipped[i] + at_nodes

    def dissipated_energy(self) -> float:
        """Energy dissipated by friction up to the end of the last step. Collective."""
        return float(self._slave.comm.allreduce(self.dissipated, op=MPI.SUM))
