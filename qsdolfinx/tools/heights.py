"""Compute the heights of smooth shapes above the flat facets that approximate them."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import require
from qsdolfinx.base.rounding import SINGLE
from qsdolfinx.surface.unknowns import EDGES
from qsdolfinx.tools.shapes import Shape

Array = npt.NDArray[np.float64]

#: Largest distance of vertices from a shape, over the chord error. With more, corrections would be
#: those of another shape.
OFF = 0.1
#: Largest chord error, over the size of a facet: an arc of 60°. With more, heights above a facet
#: are not those of a neighbourhood.
COARSEST = 0.14


def heights(shape: Shape, surface: _cpp.Surface) -> Array:
    """Heights of a shape above a surface's facets at nodes of degree 2, along outward normals.

    Returns:
        Shape (facets, nodes); infinity if the normal does not meet the shape.
    """
    x, n = np.asarray(_cpp.flat_nodes(surface)), np.asarray(_cpp.flat_normals(surface))
    flat_x, flat_n = x.reshape(-1, 3), n.reshape(-1, 3)
    height = np.zeros(len(flat_x))
    with np.errstate(all="ignore"):
        for _ in range(8):  # Newton's method; linear up to second order
            distance, direction = shape.distance(flat_x + height[:, None] * flat_n)
            height = height - distance / np.sum(direction * flat_n, axis=1)
        left = np.abs(shape.distance(flat_x + height[:, None] * flat_n)[0])
    good = left <= 1e-9 * np.maximum(np.abs(height), np.abs(flat_x).max(initial=0.0))
    return np.where(good, height, np.inf).reshape(x.shape[:2])


def check_near(shape: Shape, kind: str, surface: _cpp.Surface, comm: MPI.Intracomm) -> None:
    """Check that vertices of facets are on a shape. Collective.

    Args:
        shape: Shape that the facets approximate.
        kind: Name of the shape in messages.
        surface: The facets.
        comm: Their communicator.

    Raises:
        ValueError: If the vertices are not on the shape, or the facets are too coarse for it.
    """
    found = heights(shape, surface)
    corners = np.asarray(surface.facet_x).shape[1]
    at_vertices = np.max(np.abs(found[:, :corners]), initial=0.0)
    with np.errstate(invalid="ignore"):
        chord = np.max(np.abs(found - _between_vertices(found, corners)), initial=0.0)
    largest = np.nan_to_num(np.array([at_vertices, chord]), nan=np.inf)
    comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    off, chord = (float(value) for value in largest)
    size = float(surface.facet_size_range[1])
    require(
        chord <= COARSEST * size and np.isfinite(off),
        f"shape: the facets of the surface are not on the {kind}, or too coarse for it: they "
        "turn by more than 60°",
    )
    require(
        off <= OFF * chord + SINGLE * size,
        f"shape: vertices of the surface are up to {off:.2g} off the {kind}, whose chord error "
        f"is {chord:.2g}: name the surface that they are on, or take {kind}.fit",
    )


def _between_vertices(values: Array, corners: int) -> Array:
    """The linear or bilinear function with the same values at the vertices, at all nodes."""
    columns = [values[:, i] for i in range(corners)]
    columns += [(values[:, a] + values[:, b]) / 2 for a, b in EDGES[corners]]
    if corners == 4:
        columns.append(values[:, :4].mean(axis=1))
    return np.stack(columns, axis=1)
