"""Limits for curved facets, which are those of meshes of degree 2."""

from __future__ import annotations

import typing

from qsdolfinx.base.checks import require
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.heights import COARSEST


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
