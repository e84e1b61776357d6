"""Self-contact: surfaces for boundaries that may touch themselves."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Facets = npt.NDArray[np.int32]


def boundary_of(surface: Surface) -> Surface:
    """Surface of the whole boundary of a body, for self-contact of the given surface. Collective.

    Only facets of the given surface may be in contact. The other facets occlude what is behind
    them, and show what is inside the body. Which of two touching facets is the slave follows from
    their present normals and positions in the axes of the body, see is_slave_of in
    cpp/pairing/roles.h: it turns with the body.

    Raises:
        ValueError: If the boundary is not closed, for example because cells at the boundary are
            turned inside out.
    """
    msh = surface.mesh
    every = mesh.exterior_facet_indices(msh.topology)
    facets = np.union1d(every, surface.facets).astype(np.int32)
    if surface.axisymmetric:
        facets = _off_axis(surface, facets)
    out = Surface(surface.V, facets=facets, axisymmetric=surface.axisymmetric)
    x, behind, _ = out.coordinates
    area, middle = area_vectors(x), x.mean(axis=1)
    area = np.sign(np.sum(area * (middle - behind), axis=1))[:, None] * area
    size = np.linalg.norm(area, axis=1)
    normal = area / size[:, None]
    inside = _cpp.within_body(out.cpp_object, middle, normal, np.arange(len(size)))
    centre, axes = _frame(surface.comm, middle, size)
    key = np.column_stack([normal @ axes, (middle - centre) @ axes, 1.0 - inside])
    key[~np.isin(out.facets, surface.facets)] = np.nan
    out.touch_itself(key)
    if not surface.axisymmetric:
        local = np.append(area.sum(axis=0), size.sum())
        total = surface.comm.allreduce(local, op=MPI.SUM)
        if np.linalg.norm(total[:3]) > SOLVED * total[3]:
            raise ValueError(
                "slave and master: contact of a surface with itself needs a closed boundary of the "
                "mesh to know what is inside, and it is not closed: are cells turned inside out?"
            )
    return out


def _frame(comm: MPI.Intracomm, x: Array, area: Array) -> tuple[Array, Array]:
    """Centre of a surface, (3,), and its principal axes as columns, (3, 3). Collective.

    Axes point to where the surface reaches out farther (third moments). Where moments do not
    determine the axes, as those of symmetric bodies, axes of space are taken for them.

    Args:
        comm: Communicator of the surface.
        x: Middles of its facets, (facets, 3).
        area: Their areas, (facets,).
    """

    def total(values: Array) -> Array:
        return np.asarray(comm.allreduce(values.sum(axis=0), op=MPI.SUM))

    centre = total(area[:, None] * x) / total(area)
    away = x - centre
    moments = total(area[:, None, None] * away[:, :, None] * away[:, None, :])
    sizes, axes = np.linalg.eigh(moments)
    if np.diff(sizes).min() < SOLVED * sizes.max():
        return centre, np.eye(3)
    along = away @ axes
    third, most = (total(area[:, None] * f(along) ** 3) for f in (np.asarray, np.abs))
    fixed = axes[np.argmax(np.abs(axes), axis=0), np.arange(3)]
    return centre, axes * np.sign(np.where(np.abs(third) > SOLVED * most, third, fixed))


def _off_axis(surface: Surface, facets: Facets) -> Facets:
    """Remove the facets on the axis r = 0, which have no area."""
    msh = surface.mesh
    tdim = msh.topology.dim
    x = mesh.entities_to_geometry(msh, tdim - 1, facets)
    r = msh.geometry.x[x, 0].max(axis=1)
    return np.asarray(facets[r > ROUNDING * surface.facet_size_range[0]], dtype=np.int32)
