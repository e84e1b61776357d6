"""Kinematics of a contact: displacements of its surfaces from the unknowns of both bodies."""

from __future__ import annotations

import typing

from qsdolfinx.base.checks import POSITIVE, check, one_of, require

UNKNOWNS = ("displacement", "velocity")

_UNUSED = 'needs unknown="velocity" on at least one side, or friction that depends on slip rates'


def unknowns_of(unknown: typing.Any, rigid_master: bool = False) -> tuple[str, str]:
    """Return the names of the unknowns of the slave and the master.

    A rigid master has the kind of unknown of its slave.

    Raises:
        ValueError: If there are not one or two names, or a name is not valid.
    """
    both = (unknown, unknown) if isinstance(unknown, str) else unknown
    two = isinstance(both, typing.Sequence) and len(both) == 2
    require(two, "unknown: must be one name, or one for the slave and the master")
    for name in both:
        check(one_of(UNKNOWNS), unknown=name)
    return both[0], both[0 if rigid_master else 1]


class Kinematics:
    """Displacements of both bodies: u = x for displacements x, u = x Δt, (2), for velocities x.

    With velocities on both sides, λ = ε [ḡ]₊ is the penalty form of (3), with v at t + Δt on both
    sides and the penalty ε Δt (stress per velocity).

    Args:
        unknown: ``"displacement"`` or ``"velocity"``, or a pair of these names for the slave and
            the master.
        dt: Δt, time; None if nothing needs it.
        rates: Whether friction depends on rates, and therefore needs Δt.

    Raises:
        ValueError: If a name is not valid, or Δt is not positive, missing, or not used.
    """

    def __init__(
        self,
        unknown: str | typing.Sequence[str],
        dt: float | None,
        rates: bool = False,
    ) -> None:
        #: Names of the unknowns of the slave and of the master.
        self.unknown: tuple[str, str] = unknowns_of(unknown)
        if "velocity" in self.unknown or rates:
            why = "dt: must be given, since velocities, friction or heat of friction depend on it"
            require(dt is not None, why)
            check(POSITIVE, dt=dt)
        else:
            require(dt is None, f"dt: {_UNUSED}")
        self._dt = None if dt is None else float(dt)

    @property
    def dt(self) -> float | None:
        """Δt, time."""
        return self._dt

    @dt.setter
    def dt(self, value: float) -> None:
        self.check_dt(value)
        self._dt = float(value)

    def check_dt(self, value: typing.Any) -> None:
        """Refuse a Δt that is not positive, or not used."""
        require(self._dt is not None, f"dt: {_UNUSED}")
        check(POSITIVE, dt=value)

    def restore_dt(self, dt: float | None) -> None:
        """Restore a Δt that was read before."""
        self._dt = dt

    @property
    def in_displacement(self) -> tuple[bool, bool]:
        """Whether slave and master are displacement-based, with unknowns kept from step to step."""
        return self.unknown[0] == "displacement", self.unknown[1] == "displacement"

    @property
    def scale(self) -> tuple[float, float]:
        """∂u/∂x of the slave and the master: 1, or Δt (time)."""
        s, m = (1.0 if name == "displacement" else self._dt or 0.0 for name in self.unknown)
        return s, m
