"""What gaps are measured from: facets, or the curved surfaces that they approximate."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require, shown
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.heights import COARSEST, check_near
from qsdolfinx.tools.rigid_surface import AnySurface, as_tool
from qsdolfinx.tools.smooth import Smooth

Array = npt.NDArray[np.float64]

SMOOTHINGS = ("none", "shared-curvature")
LIFTS = ("none", "shared", "own")  # in the order of Lift in cpp/surface/relief.h

#: What one side may be given: a name, a smooth surface, or None for "none".
Side = str | Smooth | None


class Relief(typing.NamedTuple):
    """One side's surface over its facets, as the extension takes it; see cpp/surface/relief.h.

    Attributes:
        lift: Number of what counts of it, in LIFTS.
        known: Whether it is known; otherwise nothing but the turning between facets tells.
        heights: Over the facets' nodes of degree 2 (length), shape (facets, nodes), or empty.
    """

    lift: int
    known: bool
    heights: Array

    @classmethod
    def unknown(cls, lift: str = "none") -> Relief:
        """Of facets without anything that tells what they approximate."""
        return cls(LIFTS.index(lift), False, np.zeros(0))


def sides_of(smoothing: typing.Any, master: AnySurface) -> tuple[Side, Side]:
    """What is given for slave and master.

    Raises:
        ValueError: If it is neither a name or a smooth surface nor a pair of such.
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
    """What the gaps of a contact are measured from, on both sides.

    Shapes say how far they are over the facets as these are now; that moves with the bodies.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        sides: Of each, from :func:`sides_of`.
        follows: Whether facets are cut where displacements put their vertices: they are flat then,
            where these are of degree 1, whatever the mesh is.

    Raises:
        ValueError: If vertices are not on the shape that is named for them. Collective.
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
        """Whether anything was asked for."""
        return self._sides != (None, None)

    def covers(self, surface: AnySurface) -> bool:
        """Whether gaps are measured from what the surface's facets approximate."""
        return self.relief(surface).lift > 0

    def relief(self, surface: AnySurface) -> Relief:
        """The surface over its facets as they are now."""
        i = int(surface is self._master)
        found = self._shaped[i]
        tool = as_tool(surface)
        if found is None and tool is None:
            found = typing.cast(Surface, surface).heights
        if found is not None:
            # Displacements that are linear on a facet cannot flatten its bulge.
            straight = "none" if self._follows else "shared"
            lift = straight if surface.degree == 1 else "own"
            return Relief(LIFTS.index(lift), True, found)
        return Relief.unknown("none" if self._sides[i] is None else "shared")


class CurvedError(ValueError):
    """Facets are more curved than gaps can be measured to; a smaller step may bend them less."""


def check_curved(surfaces: typing.Iterable[Surface], quadrature: str, facets: bool) -> None:
    """Refuse facets that are too curved, or what does not see that they are. Same on all ranks.

    Args:
        surfaces: Those of bodies.
        quadrature: Where the gap is sampled.
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
