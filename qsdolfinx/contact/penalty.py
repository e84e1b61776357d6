"""The automatic penalty, from the stiffness of the bodies where they touch."""

from __future__ import annotations

import math
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from qsdolfinx.surface.surface import Surface

#: Ratio of the automatic penalty to the stiffness of the bodies, by quadrature. At nodes a large
#: one does no harm. On the overlay every facet's mean gap is resisted, and where contact ends
#: within a facet a stiff penalty makes multipliers oscillate; this one balances that error and the
#: penalty's, see bench/hertz_penalty.py.
FACTORS = {"nodal": 100.0, "overlay": 5.0}

#: The same with an augmented Lagrangian, which closes the gap whatever the penalty; by whether its
#: multipliers come from one linear system, which a soft one keeps fast, or from updates, of which a
#: stiffer one takes fewer.
AUGMENTED_FACTORS = {False: 10.0, True: 3.0}

#: The same with constraints at points, in units of the slave's facets, to which the multipliers
#: belong. What these cannot follow of the gaps between polygons a stiffer one would press out of a
#: finer master's traction; with a softer one pressures at the edge of contact are less accurate.
POINTS_FACTOR = 4.0

#: The same where gaps follow the bodies. What bodies come nearer to each other, or bend, in a step
#: gives y of points their sign before multipliers have theirs: with 1 half rings of degree 2 that
#: pass each other lose contact in one iteration, and all points close in the next.
FOLLOWING_FACTOR = 0.3

#: That of slips at points, in units of the softer side's stiffness: a stiffer one changes their
#: sense in each iteration.
SLIPS_FACTOR = 1.5

#: Penalty over stiffness up to which multigrid needs at most some twice the iterations that it
#: needs with a soft one; and from which on a direct solver's error, about 1e-15 of this ratio,
#: is no longer small compared with the tolerances. tests/contact/test_report.py measures both.
MODERATE, EXTREME = 30.0, 1e7


def nodal_stiffness(
    surface: Surface, matrix: PETSc.Mat, constrained: PETSc.Vec, scale: float
) -> tuple[float, float]:
    """Stiffness of a body at its surface, from the free unknowns' K_kk. Collective.

    Args:
        surface: Contact surface.
        matrix: The body's bulk block.
        constrained: Nonzero at unknowns with Dirichlet conditions.
        scale: Displacement per unknown: 1, or Δt for velocities.

    Returns:
        Mean of K_kk / S_k, stress per length; and of K_kk S_k^(1/(gdim-1)) / S_k, a stress of the
        order of Young's modulus. Infinity if no unknown is free: a rigid side is no bound.
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
    """The penalty, stress per length, for the nodal stiffness of the two sides.

    A multiple of the softer side's stiffness. With an augmented Lagrangian of the softer side's
    modulus over the finer side's facet size: the finer side has the modes that converge last. With
    constraints at points over that of the slave; with a penalty there over the coarser side's, so
    that it is as soft as its multipliers would be, whichever is the slave.

    Args:
        stiffness: Mean of K_kk / S_k of each side, stress per length.
        modulus: Of each side, stress, see :func:`nodal_stiffness`.
        quadrature: ``"nodal"`` or ``"overlay"``.
        augmented: Whether augmented multipliers close the gap.
        together: Whether its multipliers come from one linear system: tied contact with ``"amg"``.
        at_points: Factor of constraints at points, 0 of others.

    Raises:
        ValueError: If neither gives a positive number, or one gives NaN.
    """
    for side, value in zip(("slave", "master"), stiffness, strict=False):
        if math.isnan(value):
            raise ValueError(
                f"F: the stiffness of the {side}'s body is not finite (NaN) at its surface: "
                "look at the coefficients of F and at the values of u"
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
    """The penalty of an augmented Lagrangian; arguments as of :func:`automatic_penalty`."""
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
    """What :func:`automatic_penalty` has done, in words; arguments as there."""
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
    """Facet size of each side, infinite where nothing is free."""
    pairs = zip(stiffness, modulus, strict=True)
    return [E / k if 0 < k < math.inf else math.inf for k, E in pairs]


def _coarser(sizes: list[float]) -> int:
    """Side of the larger facets, of those where something is free."""
    return int(np.argmax([size if size < math.inf else -math.inf for size in sizes]))


def _factor(together: bool, at_points: float) -> float:
    return at_points or AUGMENTED_FACTORS[together]


def points_factor(constraints: str, follows: bool) -> float:
    """Of constraints at points; 0 of others.

    Args:
        constraints: ``"nodes"`` or ``"points"``.
        follows: Whether gaps follow the bodies.
    """
    if constraints != "points":
        return 0.0
    return FOLLOWING_FACTOR if follows else POINTS_FACTOR


class Penalty:
    """ε of a contact, stress per length: given, or computed from the stiffness of its bodies.

    Args:
        given: A number, or ``"auto"``.
        quadrature: ``"nodal"`` or ``"overlay"``.
        augmented: Whether augmented multipliers close the gap.
        flows: Whether a body has velocities.
        at_points: Factor of constraints at points, see :func:`points_factor`; 0 of others.
    """

    def __init__(
        self, given: float | str, quadrature: str, augmented: bool, flows: bool, at_points: float
    ) -> None:
        self._quadrature, self._augmented, self._flows = quadrature, augmented, flows
        self._at_points = at_points
        self.automatic = isinstance(given, str)
        #: The number; None as long as an automatic one has not been computed.
        self.value: float | None = None if isinstance(given, str) else float(given)
        #: How it was chosen.
        self.source = "automatic, at the first solve" if self.automatic else "given"
        #: Mean K_kk / S_k (stress per length) at the contact nodes of the slave and of a deformable
        #: master, when matrices were last made.
        self.stiffness: tuple[float, ...] = ()
        #: γ of multipliers at points (stress per length), from these; None if they give none.
        self.of_points: float | None = None
        #: That of slips there.
        self.of_slips: float | None = None

    @property
    def eps(self) -> float:
        """The number.

        Raises:
            RuntimeError: If an automatic one has not been computed yet.
        """
        if self.value is None:
            raise RuntimeError(
                'penalty="auto" has not been computed yet, which the first solve does: '
                "call problem.set_up() to compute it before"
            )
        return self.value

    @property
    def is_measured(self) -> bool:
        """Whether it is known, and the stiffness of the bodies with it."""
        return self.value is not None and bool(self.stiffness)

    def let_follow(self) -> None:
        """Let the contact follow its bodies, which has another automatic penalty at points."""
        if self._at_points:
            self._at_points = FOLLOWING_FACTOR
            self.of_points = self.of_slips = None
        if self.automatic:
            self.value = None

    def set(self, value: float) -> None:
        """Give a number."""
        self.value, self.automatic, self.source = float(value), False, "given"

    def set_automatic(self, value: float, source: str) -> None:
        """Set a number that was computed as ``source`` says."""
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

        Once: with another ε the gaps of the last step would be wrong ones. But an augmented
        Lagrangian may have any, and that of bodies in velocities follows Δt and how fast they flow.
        Arguments are those of :func:`automatic_penalty`.
        """
        # What follows the bodies goes on with the areas of the start, also after a restart.
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
