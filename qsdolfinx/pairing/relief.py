"""Surface correction for curvature: gaps between facets, or between the curved surfaces."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require, shown
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.heights import COARSEST, check_near
from qsdolfinx.tools.rigid_surface import AnySurface
from qsdolfinx.tools.smooth import Smooth

Array = npt.NDArray[np.float64]

SMOOTHINGS = ("none", "shared-curvature")
LIFTS = ("none", "shared", "own")  # in the order of Lift in cpp/surface/relief.h

#: Smoothing of one side: a name, a smooth surface, or None for "none".
Side = str | Smooth | None


class Relief(typing.NamedTuple):
    """Curved surface of one side, relative to its facets, see cpp/surface/relief.h.

    Attributes:
        lift: Part of the correction that is used, as a number in LIFTS.
        known: Whether the surface is known; otherwise it is estimated from the angles between
            facets.
        heights: Heights over the facets' nodes of degree 2 (length), shape (facets, nodes), or
            empty.
    """

    lift: int
    known: bool
    heights: Array

    @classmethod
    def unknown(cls, lift: str = "none") -> Relief:
        """Correction for facets whose curved surface is not known."""
        return cls(LIFTS.index(lift), False, np.zeros(0))


def sides_of(smoothing: typing.Any, master: AnySurface) -> tuple[Side, Side]:
    """Return the smoothing of slave and master.

    Raises:
        ValueError: If ``smoothing`` is neither a name, nor a smooth surface, nor a pair of these.
    """
    analytic = master.is_analytic
    both = (
        smoothing if isinstance(smoothing, (tuple, list)) else (smoothing,) * (1 + (not analytic))
    )
    both = tuple(both) + (None,) * (2 - len(both))
    known = len(both) == 2 and all(
        side is None or isinstance(side, Smooth) or (isinstance(side, str) and side in SMOOTHINGS)
        for side in both
    )
    require(
        known,
        f"smoothing: must be one of {', '.join(SMOOTHINGS)}, a surface of qs.smooth, or a pair of "
        f"these for slave and master, not {shown(smoothing)}",
    )
    first, second = (None if side == "none" else side for side in both)
    require(
        second is None or not analytic,
        "smoothing: the master is an analytic shape, without facets; give it for the slave only",
    )
    return first, second


class Smoothing:
    """Surface corrections for curvature of both sides of a contact. Collective.

    The heights of a given shape over the facets are computed in the present position; they move
    with the bodies.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        sides: Smoothing of each side, from :func:`sides_of`.
        follows: Whether segmentation uses the displaced vertices of the facets. For displacements
            of degree 1 the facets are then flat, for any mesh.

    Raises:
        ValueError: If vertices are not on the shape that is given for them.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        sides: tuple[Side, Side],
        follows: bool = False,
    ) -> None:
        self._master, self._follows = master, follows
        self._sides = sides
        self._shaped: list[Array | None] = [None, None]
        for i, (surface, name) in enumerate(((slave, "slave"), (master, "master"))):
            side = sides[i]
            if isinstance(side, Smooth):
                facets = surface.search_object(slave)
                kind = type(side).__name__
                self._shaped[i] = check_near(side.shape, kind, facets, slave.comm, name)

    def __bool__(self) -> bool:
        """Whether smoothing was requested on any side."""
        return self._sides != (None, None)

    def covers(self, surface: AnySurface) -> bool:
        """Whether gaps are measured from the curved surface that the facets approximate."""
        return self.relief(surface).lift > 0

    def relief(self, surface: AnySurface) -> Relief:
        """Correction of a surface, relative to its facets in their present position."""
        i = int(surface is self._master)
        found = surface.heights if self._shaped[i] is None else self._shaped[i]
        if found is not None:
            # Displacements that are linear on a facet cannot flatten its curvature.
            straight = "none" if self._follows else "shared"
            lift = straight if surface.degree == 1 else "own"
            return Relief(LIFTS.index(lift), True, found)
        return Relief.unknown("none" if self._sides[i] is None else "shared")


class CurvedError(ValueError):
    """Facets are too curved to measure gaps; a smaller step may bend them less."""


def check_curved(surfaces: typing.Iterable[Surface], quadrature: str, facets: bool) -> None:
    """Refuse facets that are too curved, for measuring gaps or for the nodal rule.

    The result is the same on all ranks.

    Args:
        surfaces: Surfaces of bodies.
        quadrature: Name of the quadrature.
        facets: Whether the partner has facets.
    """
    for surface in surfaces:
        bulge = surface.largest_height
        require(
            bulge <= COARSEST * surface.facet_size_range[1],
            "V: contact facets of degree 2 are more curved than an arc of 60°; refine the mesh",
            CurvedError,
        )
        require(
            bulge == 0 or quadrature != "nodal" or not facets,
            "quadrature: the nodal rule measures gaps to straight facets, and those of a mesh "
            'geometry of degree 2 are curved; use quadrature="overlay"',
        )
