"""True gaps: signed distances of the deformed surfaces, computed on request.

The weighted gaps that the law closes are means around nodes. Where facets are large compared with
the features they touch, or meet the surface at an angle, surfaces can be closed in the mean and
still penetrate each other.
"""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place, Placement, is_analytic
from qsdolfinx.gap.weighted_gap import KINDS, WeightedGap
from qsdolfinx.pairing.distance import (
    Distances,
    from_shape,
    of_nodes,
    of_points,
    on_facets,
    overlay_points,
)
from qsdolfinx.surface.affine import affine_vec

Array = npt.NDArray[np.float64]

SIDES = ("slave", "master")


@dataclasses.dataclass(frozen=True)
class DeepPlace:
    """Place where surfaces penetrate each other.

    Attributes:
        x: Deformed position of the point, shape (gdim,).
        depth: Depth of the point in the other surface (length).
        side: Side of the point, ``"slave"`` or ``"master"``.
    """

    x: tuple[float, ...]
    depth: float
    side: str

    def __str__(self) -> str:
        place = ", ".join(f"{x:.4g}" for x in self.x)
        return f"{self.depth:.4g} at ({place}) of the {self.side}"


@dataclasses.dataclass
class Measured:
    """Distances that have been measured for a placement.

    Attributes:
        placement: Positions of the surfaces.
        gaps: Signed distance (length) of the nodes of each side, positive in penetration, NaN where
            nothing is within the search distance.
        samples: All sampled distances that count for the penetration, for each sampled side.
    """

    placement: Placement
    gaps: dict[str, Array]
    samples: list[tuple[str, Distances]] | None = None


def gap(model: ContactModel, side: str) -> Array:
    """Signed distances at the nodes of a deformable side, positive in penetration. Collective."""
    measured = _measured(model)
    if side not in measured.gaps:
        with model.watch.stage("gap"):
            measured.gaps[side] = _gaps(model, side)
    return measured.gaps[side].copy()


def penetration(model: ContactModel) -> float:
    """Largest depth of nodes and, on an overlay, of points; 0 if there is none. Collective."""
    depths = [float(np.max(_counted(d), initial=0.0)) for _, d in _samples(model)]
    return float(model.comm.allreduce(max(depths), op=MPI.MAX))


def deepest(model: ContactModel, count: int = 3) -> list[DeepPlace]:
    """Deepest places, more than the size of the smallest facet apart. Collective.

    Depths that count as closed are left out.
    """
    gdim, apart = model.slave.gdim, model.paired.facet_size
    samples = [(side, d.x[:, :gdim], _counted(d)) for side, d in _samples(model)]
    out: list[DeepPlace] = []
    digit = ROUNDING * apart  # of places of equal depths, whose order must not depend on rounding
    while len(out) < count:
        for _, x, depth in samples:
            if out:
                depth[np.linalg.norm(x - np.array(out[-1].x), axis=1) <= apart] = 0.0
        most = max(float(np.max(depth, initial=0.0)) for *_, depth in samples)
        most = model.comm.allreduce(most, op=MPI.MAX)
        if most <= max(model.allowed_gap, ROUNDING * apart):
            break
        found = [
            (tuple(place.tolist()), side)
            for side, x, depth in samples
            for place in digit * np.round(x[depth >= (1 - SOLVED) * most] / digit)
        ]
        first = min(f for each in model.comm.allgather(sorted(found)[:1]) for f in each)
        out.append(DeepPlace(first[0], most, first[1]))
    return out


def _measured(model: ContactModel) -> Measured:
    """Distances known for the present placement; the same on all ranks."""
    known = model.measured
    if not isinstance(known, Measured) or known.placement is not model.placement:
        model.measured = known = Measured(model.placement, {})
    return known


def _counted(distances: Distances) -> Array:
    """New array of depths of points in front of the other surface; 0 for all other points."""
    kept = ~distances.beside & (distances.depth > 0)
    return np.where(kept, distances.depth, 0.0)


def _gaps(model: ContactModel, side: str) -> Array:
    """Distances of the nodes of a deformable side, in the order of the surface. Collective."""
    placement, radius = model.placement, model.paired.search_radius
    place = placement.bodies[SIDES.index(side)]
    other = placement.master if side == "slave" else placement.slave
    if model.with_itself:
        return _gaps_to_itself(model, place)
    facets = place.facets()
    if is_analytic(other):
        found = from_shape(other.tool, other.positions(), _cpp.sample_nodes(facets), radius)
    else:
        found = of_nodes(facets, other.facets(), radius)
    at = np.searchsorted(facets.node_dofs[:, 0], place.surface.node_dofs[:, 0])
    return found.depth[at]


def _samples(model: ContactModel) -> list[tuple[str, Distances]]:
    """Distances of all sampled nodes and points, measured once per placement. Collective."""
    measured = _measured(model)
    if measured.samples is None:
        with model.watch.stage("gap"):
            measured.samples = _sample(model)
            measured.samples += [
                ("slave", depths_of_points(model, gap)) for gap in model.of_vertices
            ]
    return measured.samples


def _sample(model: ContactModel) -> list[tuple[str, Distances]]:
    placement, radius = model.placement, model.paired.search_radius
    sampling, gdim = model.settings.sampling, model.slave.gdim
    sides = (model.slave, model.master)
    heights = sampling.heights(model.slave), sampling.heights(model.master)
    curved = any(h is not None for h in heights)
    if curved and any(s.degree > 1 for s in sides):
        return [("slave", depths_of_points(model, gap)) for gap in model.gaps[:1]]
    slave, other = placement.slave.facets(), placement.master
    if is_analytic(other):
        points = [_cpp.sample_nodes(slave)]
        if sampling.quadrature == "overlay" and not curved:
            points.append(on_facets(slave, model.slave.num_facet_vertices))
        return [("slave", from_shape(other.tool, other.positions(), p, radius)) for p in points]
    surfaces = slave, other.facets()
    if model.with_itself:
        return [("slave", _depths_in_itself(_pairs_with_itself(model, *surfaces)))]
    out: list[tuple[str, Distances]] = []
    for i, side in enumerate(SIDES):
        own, opposite = surfaces[i], surfaces[1 - i]
        if not curved:
            out.append((side, of_nodes(own, opposite, radius)))
        if sampling.quadrature == "overlay":
            found = overlay_points(own, opposite, gdim, radius, (heights[i], heights[1 - i]))
            x, none = found.slave["x"], np.zeros(found.size, dtype=bool)
            between = Distances(x, -found.gap, none)
            if not curved:
                between = of_points(x, found.normal, own, opposite, radius)
            out.append((side, between))
    return out


def _pairs_with_itself(
    model: ContactModel, own: _cpp.Surface, same: _cpp.Surface
) -> _cpp.PairingPoints:
    """Contact points of a surface with itself, given as two equal surfaces. Collective."""
    radius = model.paired.search_radius
    return overlay_points(own, same, model.slave.gdim, radius, of_itself=True)


def _depths_in_itself(points: _cpp.PairingPoints) -> Distances:
    x = points.slave["x"]
    return Distances(x, -points.gap, np.zeros(len(x), dtype=bool))


def _gaps_to_itself(model: ContactModel, place: Place) -> Array:
    """Mean distances around owned nodes of slave facets; NaN at other nodes. Collective."""
    own, same = place.facets(), place.facets()
    points = _pairs_with_itself(model, own, same)
    operator = _cpp.GapOperator(own, same, points, jump=False, rows=KINDS.index("cover"))
    out = np.full(len(own.node_x), np.nan)
    out[operator.row_node] = -operator.initial_gap
    return out[np.searchsorted(own.node_dofs[:, 0], place.surface.node_dofs[:, 0])]


def depths_of_points(model: ContactModel, gap: WeightedGap) -> Distances:
    """Depths of the points of an integration side, as deformed with finite sliding. Collective."""
    if gap.following is None or gap.cut is None:
        return gaps_of_points(model, gap)
    x, distance = gap.following.points(gap.cut)
    return Distances(x, -distance, np.zeros(len(x), dtype=bool))


def gaps_of_points(model: ContactModel, gap: WeightedGap) -> Distances:
    """Gaps of the points between curved surfaces, linear in displacements. Collective.

    This is also used for facets that displacements of degree 2 bend: divided into flat facets, they
    would have chord errors themselves.
    """
    surfaces = gap.slave.cpp_object, gap.master.cpp_object
    operator = _cpp.GapOperator(*surfaces, gap.points, jump=False, rows=KINDS.index("points"))
    places = model.ordered(gap, (model.placement.slave, model.placement.master))
    vecs = [place.vec() for place in places]
    if model.tool_motion is not None and vecs[0] is not None:
        moved = affine_vec(gap.slave, model.tool_motion)
        vecs[0].axpy(-1.0, moved)
        moved.destroy()
    change = operator.apply(handle_of(vecs[0]), handle_of(vecs[1]))[:, 0]
    for vec in vecs:
        if vec is not None:
            vec.destroy()
    x = gap.points.slave["x"]
    return Distances(x, change - gap.points.gap, np.zeros(len(x), dtype=bool))
