"""The automatic penalty, computed from the stiffness of the bodies at the contact surfaces."""

from __future__ import annotations

import math
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from qsdolfinx.surface.surface import Surface

#: Ratio of the automatic penalty to the stiffness of the bodies, by quadrature. With nodal
#: quadrature, a large ratio does no harm. On the overlay, the penalty acts on the mean gap of every
#: facet, and where contact ends within a facet a stiff penalty makes multipliers oscillate. This
#: ratio balances that error and the error of the penalty, see bench/hertz_penalty.py.
FACTORS = {"nodal": 100.0, "overlay": 5.0}

#: This ratio with an augmented Lagrangian, which closes the gap with any penalty. The key says
#: whether the multipliers come from one linear system, which is solved faster with a soft penalty,
#: or from multiplier updates, of which a stiffer penalty needs fewer.
AUGMENTED_FACTORS = {False: 10.0, True: 3.0}

#: This ratio with constraints at points, for the facet size of the slave, which carries the
#: multipliers. The multipliers cannot represent all of the gaps between polygons. A stiffer penalty
#: would show the remaining gaps in the traction of a finer master; with a softer penalty, pressures
#: at the edge of contact are less accurate.
POINTS_FACTOR = 4.0

#: This ratio with finite sliding. The approach or bending of bodies in a step determines the sign
#: of y at points before the multipliers do: with a ratio of 1, half rings of degree 2 that pass
#: each other lose contact in one iteration, and all points become active in the next.
FOLLOWING_FACTOR = 0.3

#: Penalty of slips at points over the stiffness of the softer side: with a stiffer penalty the
#: direction of slip changes in each iteration.
SLIPS_FACTOR = 1.5

#: Limits of penalty over stiffness. Up to the first, multigrid needs at most about twice the
#: iterations that it needs with a soft penalty. Above the second, the error of a direct solver,
#: about 1e-15 of this ratio, is no longer small compared with the tolerances.
#: tests/contact/test_report.py measures both.
MODERATE, EXTREME = 30.0, 1e7


def nodal_stiffness(
    surface: Surface, matrix: PETSc.Mat, constrained: PETSc.Vec, scale: float
) -> tuple[float, float]:
    """Stiffness of a body at its surface, from K_kk of the free unknowns. Collective.

    Args:
        surface: Contact surface.
        matrix: The body's bulk block.
        constrained: Nonzero at unknowns with Dirichlet conditions.
        scale: Displacement per unknown: 1, or Δt for velocities.

    Returns:
        Mean of K_kk / S_k, stress per length; and mean of K_kk S_k^(1/(gdim-1)) / S_k, a stress of
        the order of Young's modulus. Both are infinite if no unknown is free: a rigid side does not
        limit the penalty.
    """
    diagonal = matrix.getDiagonal()
    dofs = surface.node_dofs - diagonal.owner_range[0]
    free = constrained.array_r[dofs] == 0
    stiffness = diagonal.array_r[dofs] / surface.node_area[:, None] / scale
    modulus = stiffness * surface.node_size[:, None]
    diagonal.destroy()
    sums = [stiffness[free].sum(), modulus[free].sum(), np.count_nonzero(free)]
    totals = surface.comm.allreduce(np.array(sums, dtype=np.float64), op=MPI.SUM)
    if totals[2] == 0:
        return math.inf, math.inf
    return float(totals[0] / totals[2]), float(totals[1] / totals[2])


def automatic_penalty(
    stiffness: typing.Sequence[float],
    modulus: typing.Sequence[float],
    quadrature: str,
    augmented: bool,
    together: bool,
    at_points: float,
) -> float:
    """Compute the penalty, stress per length, from the nodal stiffness of the two sides.

    The penalty is a multiple of the stiffness of the softer side. With an augmented Lagrangian it
    is a multiple of the modulus of the softer side over the facet size of the finer side, which has
    the modes that converge last. With constraints at points, the facet size is that of the slave.
    With a penalty at points it is that of the coarser side, so that the penalty is as soft as
    multipliers would be, whichever side is the slave.

    Args:
        stiffness: Mean of K_kk / S_k of each side, stress per length.
        modulus: Modulus of each side, stress, see :func:`nodal_stiffness`.
        quadrature: ``"nodal"`` or ``"overlay"``.
        augmented: Whether multipliers of an augmented Lagrangian close the gap.
        together: Whether its multipliers come from one linear system: tied contact with ``"amg"``.
        at_points: Factor of constraints at points; 0 for other constraints.

    Raises:
        ValueError: If neither side gives a positive number, or one side gives NaN.
    """
    for side, value in zip(("slave", "master"), stiffness, strict=False):
        if math.isnan(value):
            raise ValueError(
                f"F: the stiffness of the {side}'s body is not finite (NaN) at its surface: "
                "check the coefficients of F and the values of u"
            )
    if augmented:
        penalty = _usual(stiffness, modulus, together, at_points)
    elif at_points:
        sizes = _sizes(stiffness, modulus)
        penalty = POINTS_FACTOR * min(modulus) / sizes[_coarser(sizes)]
    else:
        penalty = FACTORS[quadrature] * min(stiffness)
    if not (math.isfinite(penalty) and penalty > 0):
        raise ValueError(
            'penalty: "auto" needs unknowns without Dirichlet conditions and with stiffness on the '
            "contact surfaces; give a number instead"
        )
    return penalty


def _usual(
    stiffness: typing.Sequence[float],
    modulus: typing.Sequence[float],
    together: bool,
    at_points: float,
) -> float:
    """Penalty of an augmented Lagrangian; arguments as for :func:`automatic_penalty`."""
    sizes = _sizes(stiffness, modulus)
    size = sizes[0] if at_points > 0 and sizes[0] < math.inf else min(sizes)
    return _factor(together, at_points) * min(modulus) / size


def source(
    stiffness: typing.Sequence[float],
    modulus: typing.Sequence[float],
    quadrature: str,
    augmented: bool,
    together: bool,
    at_points: float,
) -> str:
    """Describe the result of :func:`automatic_penalty` for messages; arguments as there."""
    sides = ("slave", "master")
    if augmented or at_points:
        sizes, factor = _sizes(stiffness, modulus), _factor(together, at_points)
        i = 0 if at_points and sizes[0] < math.inf else int(np.argmin(sizes))
        i = i if augmented else _coarser(sizes)
        return (
            f"automatic: {factor:g} x modulus {min(modulus):.4g} of the "
            f"{sides[np.argmin(modulus)]} / facet size {sizes[i]:.4g} of the {sides[i]}"
        )
    soft = sides[np.argmin(stiffness)]
    return f"automatic: {FACTORS[quadrature]:g} x stiffness {min(stiffness):.4g} of the {soft}"


def _sizes(stiffness: typing.Sequence[float], modulus: typing.Sequence[float]) -> list[float]:
    """Facet size of each side, infinite for a side without free unknowns."""
    pairs = zip(stiffness, modulus, strict=True)
    return [E / k if 0 < k < math.inf else math.inf for k, E in pairs]


def _coarser(sizes: list[float]) -> int:
    """Side of the larger facets, among sides with free unknowns."""
    return int(np.argmax([size if size < math.inf else -math.inf for size in sizes]))


def _factor(together: bool, at_points: float) -> float:
    return at_points or AUGMENTED_FACTORS[together]


def points_factor(constraints: str, follows: bool) -> float:
    """Factor of the automatic penalty of constraints at points; 0 for other constraints.

    Args:
        constraints: ``"nodes"`` or ``"points"``.
        follows: Whether gaps use updated geometry (finite sliding).
    """
    if constraints != "points":
        return 0.0
    return FOLLOWING_FACTOR if follows else POINTS_FACTOR


class Penalty:
    """Penalty ε of a contact, stress per length: given, or computed from its bodies' stiffness.

    Args:
        given: A number, or ``"auto"``.
        quadrature: ``"nodal"`` or ``"overlay"``.
        augmented: Whether multipliers of an augmented Lagrangian close the gap.
        flows: Whether a body is velocity-based.
        at_points: Factor of constraints at points, see :func:`points_factor`; 0 for other
            constraints.
    """

    def __init__(
        self, given: float | str, quadrature: str, augmented: bool, flows: bool, at_points: float
    ) -> None:
        self._quadrature, self._augmented, self._flows = quadrature, augmented, flows
        self._at_points = at_points
        self.automatic = isinstance(given, str)
        #: Value of the penalty; None as long as an automatic penalty has not been computed.
        self.value: float | None = None if isinstance(given, str) else float(given)
        #: How it was chosen.
        self.source = "automatic, at the first solve" if self.automatic else "given"
        #: Mean K_kk / S_k (stress per length) at the contact nodes of the slave and of a deformable
        #: master, when matrices were last assembled.
        self.stiffness: tuple[float, ...] = ()
        #: γ of multipliers at points (stress per length), computed from this stiffness; None if it
        #: gives no valid γ.
        self.of_points: float | None = None
        #: γ of slips at points.
        self.of_slips: float | None = None

    @property
    def eps(self) -> float:
        """Value of the penalty.

        Raises:
            RuntimeError: If an automatic penalty has not been computed yet.
        """
        if self.value is None:
            raise RuntimeError(
                'penalty="auto" has not been computed yet, which the first solve does: '
                "call problem.set_up() to compute it before"
            )
        return self.value

    @property
    def is_measured(self) -> bool:
        """Whether the penalty and the stiffness of the bodies are known."""
        return self.value is not None and bool(self.stiffness)

    def let_follow(self) -> None:
        """Change to finite sliding, which has another automatic penalty at points."""
        if self._at_points:
            self._at_points = FOLLOWING_FACTOR
            self.of_points = self.of_slips = None
        if self.automatic:
            self.value = None

    def set(self, value: float) -> None:
        """Set the penalty to a given number."""
        self.value, self.automatic, self.source = float(value), False, "given"

    def set_automatic(self, value: float, source: str) -> None:
        """Set an automatic penalty that was computed as the text ``source`` describes."""
        self.value, self.source = value, source

    @property
    def ratio(self) -> float:
        """Penalty over stiffness of the softer side; 0 if either is not known."""
        softest = min(self.stiffness, default=0.0)
        return self.value / softest if self.value is not None and softest > 0 else 0.0

    def follow(
        self, stiffness: tuple[float, ...], modulus: tuple[float, ...], together: bool
    ) -> None:
        """Store the bodies' stiffness, and compute an automatic penalty from it.

        An automatic penalty is computed only once, since another ε would make the gaps of the last
        step wrong. An exception is the augmented Lagrangian, which allows any penalty: for
        velocity-based bodies its penalty is adapted to Δt and the rate of flow. Arguments are those
        of :func:`automatic_penalty`.
        """
        # Contact with finite sliding keeps the areas of the start, also after a restart.
        goes_on = self._at_points == FOLLOWING_FACTOR and not self._flows
        if not (self.stiffness and goes_on):
            self.stiffness = stiffness
        follows = self._augmented and self._flows
        if self._at_points and (self.of_points is None or follows):
            usual = _usual(stiffness, modulus, together, self._at_points)
            self.of_points = usual if 0 < usual < math.inf else None
            softest = SLIPS_FACTOR * min(stiffness, default=0.0)
            self.of_slips = softest if 0 < softest < math.inf else None
        if self.automatic and (self.value is None or follows):
            kind = self._quadrature, self._augmented, together, self._at_points
            known = automatic_penalty(stiffness, modulus, *kind)
            self.set_automatic(known, source(stiffness, modulus, *kind))
