"""Deformed surfaces as new objects; surfaces and pairs of the contact do not change."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.surface.affine import trace_positions
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.surface.surface import Coordinates, Surface

Array = npt.NDArray[np.float64]
T = typing.TypeVar("T", np.float64, np.int64)

#: Linear facets into which a facet is split, by its number of vertices and its degree.
_PIECES = {
    (2, 1): [(0, 1)],
    (3, 1): [(0, 1, 2)],
    (4, 1): [(0, 1, 2, 3)],
    (2, 2): [(0, 2), (2, 1)],
    (3, 2): [(0, 3, 4), (3, 1, 5), (4, 5, 2), (3, 5, 4)],
    (4, 2): [(0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)],
}


class DegenerateFacetsError(ValueError):
    """Deformed facets have no area or are not finite: no distances to them can be measured."""


def trace_values(surface: Surface, vec: PETSc.Vec) -> Array:
    """Copy of a body vector's values at the trace unknowns that this rank owns."""
    return np.asarray(vec.array_r[surface.own_trace], dtype=np.float64)


def deformed_surface(
    surface: Surface, coordinates: Coordinates, displacement: Array | None
) -> _cpp.Surface:
    """Return the displaced surface, with nodes at its vertices only. Collective.

    Facets of degree 2, which bend, are split into flat facets at their nodes. The facets of
    axisymmetric surfaces count as lines.

    Args:
        surface: The surface.
        coordinates: Coordinates of its facets, as ``surface.coordinates``.
        displacement: Displacements of the trace (length), as :func:`trace_values`; None for none.

    Raises:
        DegenerateFacetsError: If the coordinates of a facet are not finite, or it has no area.
    """
    inside = coordinates[1]
    pieces = np.array(_PIECES[surface.num_facet_vertices, surface.degree])
    at_nodes = trace_positions(surface, coordinates)
    meshed = _cut(at_nodes, pieces)
    outwards = meshed.mean(axis=1) - np.repeat(inside, len(pieces), axis=0)
    sign = np.sign(np.sum(area_vectors(meshed) * outwards, axis=1))
    dofs, owner = surface.trace_dofs
    moved = _cut(deformed_positions(surface, coordinates, displacement), pieces)
    try:
        with collective_errors(surface.comm):
            _check(moved, meshed)
    except ValueError as error:
        raise DegenerateFacetsError(str(error)) from error
    return _cpp.Surface(
        comm=surface.comm.py2f(),
        gdim=surface.gdim,
        block=surface.block,
        num_vertices=moved.shape[1],
        x=moved,
        degree=1,
        dofs=_cut(dofs, pieces),
        owner=np.ascontiguousarray(owner[:, pieces].reshape(-1, pieces.shape[1])),
        inside=np.ascontiguousarray(moved.mean(axis=1) - sign[:, None] * area_vectors(moved)),
        local_size=surface.V.dofmap.index_map.size_local * surface.V.dofmap.index_map_bs,
        axisymmetric=False,
        key=None if surface.key is None else np.repeat(surface.key, len(pieces), axis=0),
    )


def deformed_positions(
    surface: Surface, coordinates: Coordinates, displacement: Array | None
) -> Array:
    """Displaced positions of the nodes of the trace, (facets, nodes, 3). Collective.

    Arguments as for :func:`deformed_surface`.
    """
    out = trace_positions(surface, coordinates).copy()
    if displacement is not None:
        out[..., : surface.gdim] += _on_facets(surface, displacement, surface.trace_dofs[0])
    return out


def _cut(values: npt.NDArray[T], pieces: npt.NDArray[np.int_]) -> npt.NDArray[T]:
    """Values at the nodes of the split facets, from values at the nodes of the facets."""
    return np.ascontiguousarray(values[:, pieces].reshape(-1, pieces.shape[1], values.shape[2]))


def _check(x: Array, meshed: Array) -> None:
    """Refuse facets without an area, except for rounding."""
    if not np.isfinite(x).all():
        raise ValueError("displacements of contact facets are not finite (NaN, infinity)")
    width, before = (np.ptp(facets, axis=1).max(axis=1) for facets in (x, meshed))
    vanished = int(np.count_nonzero(width <= ROUNDING * before))
    if flat := max(vanished, _cpp.count_degenerate(x.shape[1], x)):
        raise ValueError(
            f"{flat} deformed contact facets are degenerate (zero area, or not convex), so that "
            "distances to them are not defined"
        )


def _on_facets(surface: Surface, own: Array, dofs: npt.NDArray[np.int64]) -> Array:
    """Values of the owned unknowns of the trace at the nodes of this rank's facets. Collective."""
    vec = surface.create_vec()
    vec.array[surface.own_trace] = own
    wanted = PETSc.IS().createGeneral(dofs.ravel().astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    out = PETSc.Vec().createSeq(dofs.size, comm=PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, wanted, out, None)
    scatter.scatter(vec, out)
    values = np.array(out.array_r, dtype=np.float64).reshape(dofs.shape)
    for thing in (scatter, wanted, out, vec):
        thing.destroy()
    return values
