"""Contact points of edges and vertices that protrude from their facets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.facets import gathered
from qsdolfinx.pairing.points import PairingSide, with_unknowns_alone
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.unknowns import EDGES
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Ranks = npt.NDArray[np.int32]

#: Angle (radians) up to which a facet counts as parallel to the opposite surface, and its points
#: detect contact, or two edges as parallel. With less, facets of one plane in a file are not
#: parallel; edges at a few times this angle already cross.
PARALLEL = np.pi / 360
FLAT = float(np.cos(PARALLEL))

#: The same angle (5°) for updated gaps: faces that are pressed on each other turn gradually, and
#: the constraint of one of their vertices would repeat those of the points beside it.
PRESSED_FLAT = float(np.cos(np.pi / 36))

#: Angle (radians) up to which a facet may be inclined towards the opposite surface: a body that
#: bends around a tip is inclined first with one of its faces, and then with another one. By more,
#: facets of a tool are inclined at vertices that get points, and sharp edges to the normal: a
#: surface that a punch presses flat turns by less at the corner of the punch.
INCLINED = np.pi / 9
TOWARDS, UPRIGHT = float(np.sin(INCLINED)), float(np.cos(INCLINED))


#: Depth, in units of the largest facet, above which the opposite surface may be the far side of a
#: body. Edges and vertices have no points in contact that are deeper, since the points of facets
#: detect such depths, and time steps end with less penetration.
DEEPEST = 0.5


def deepest(slave: Surface) -> float:
    """Largest depth (length) of points of edges or vertices."""
    return DEEPEST * slave.facet_size_range[1]


def between(
    surfaces: tuple[Surface, AnySurface],
    on_slave: PairingSide,
    on_master: PairingSide,
    normal: Array,
    multipliers: tuple[Array, npt.NDArray[np.uint8]],
    weight: Array,
) -> _cpp.PairingPoints:
    """Contact points from given points on both surfaces.

    Args:
        surfaces: Slave and master.
        on_slave: Points on the slave.
        on_master: Points on the master.
        normal: Outward unit normals of the slave, (points, 3).
        multipliers: Functions of the multipliers (points, vertices of a facet), and the number of
            the multiplier among those of a vertex (points,).
        weight: Areas, (points,).
    """
    slave, master = surfaces
    points = _cpp.points_between(
        slave.cpp_object,
        master.search_object(slave),
        on_slave.x,
        on_slave.dofs,
        on_slave.owner,
        on_slave.shape_values,
        on_master.x,
        on_master.dofs,
        on_master.owner,
        on_master.shape_values,
        *multipliers,
        np.ascontiguousarray(normal),
        np.sum((on_master.x - on_slave.x) * normal, axis=1),
        weight,
    )
    return with_unknowns_alone(points, master)


def with_own_multipliers(
    surfaces: tuple[Surface, AnySurface],
    on_slave: PairingSide,
    on_master: PairingSide,
    normal: Array,
) -> _cpp.PairingPoints:
    """Points of the slave opposite edges or vertices of the other surface. Collective.

    A point uses a multiplier of a vertex of its facet, and has it alone while free ones are left. A
    vertex has as many multipliers as there are directions. Points closest to the vertex take them
    first, then other points.

    Args:
        surfaces: Slave and master.
        on_slave: Points on the slave.
        on_master: Points on the master.
        normal: Outward unit normals of the slave, (points, 3).
    """
    slave, x = surfaces[0], on_master.x
    functions = np.round(linear(slave, on_slave.shape_values), 9)
    nodes = np.ascontiguousarray(on_slave.dofs[:, : slave.num_facet_vertices, 0])
    owner = on_slave.owner[:, : slave.num_facet_vertices]
    vertex, number, count = _taken(slave, nodes, owner, functions, x)
    multipliers = np.zeros_like(functions)
    multipliers[np.arange(len(vertex)), vertex] = 1.0
    used = np.where(nodes >= 0, nodes, nodes[:, :1])  # an edge's ends come first
    area = np.sum(functions * gathered(slave, slave.node_area, used), axis=1)
    return between(surfaces, on_slave, on_master, normal, (multipliers, number), area / count)


def _taken(
    slave: Surface, nodes: Indices, owner: Ranks, functions: Array, x: Array
) -> tuple[Indices, npt.NDArray[np.uint8], Indices]:
    """Assign a multiplier of a vertex to each point. Collective.

    Args:
        slave: The slave.
        nodes: First unknowns of the vertices, −1 for unused entries, (points, vertices).
        owner: Ranks that own these unknowns, of the same shape.
        functions: Values of the linear functions at the points, of the same shape.
        x: Positions, (points, 3).

    Returns:
        Numbers of the vertices and of their multipliers, and the number of points that have the
        same closest vertex, at most the number of its multipliers; each (points,).
    """
    rows, last = np.arange(len(nodes)), slave.block - 1
    order = np.argsort(np.where(nodes < 0, 2.0, -functions), axis=1, kind="stable")
    vertex: Indices = order[:, 0].copy()
    count: Indices = np.ones(len(nodes), dtype=np.int64)
    number: Indices = np.full(len(nodes), last)
    waits = np.ones(len(nodes), dtype=bool)
    taken = np.zeros(len(slave.node_dofs), dtype=np.int64)
    for turn in range(order.shape[1]):
        choice = order[:, turn]
        asks = np.flatnonzero(waits & (nodes[rows, choice] >= 0))
        at = asks, choice[asks]
        places = np.column_stack([-functions[at], x[asks] / slave.facet_size_range[1]])
        found = _asked(slave, nodes[at], owner[at], places, taken)
        if turn == 0:
            count[:] = np.clip(found[:, 1], 1, slave.block)
        free = found[:, 0] <= last
        number[asks[free]], vertex[asks[free]] = found[free, 0], at[1][free]
        waits[asks[free]] = False
    return vertex, number.astype(np.uint8), count


def _asked(
    slave: Surface, node: Indices, owner: Ranks, places: Array, taken: Indices
) -> npt.NDArray[np.int64]:
    """Number each point gets at its node, and number of requests there, (points, 2). Collective.

    Args:
        slave: The slave.
        node: First unknowns of the nodes, (points,).
        owner: Ranks that own these unknowns, (points,).
        places: Keys for the order of the points of a node, independent of the partition, (points,
            n).
        taken: Number of earlier requests at owned nodes, (nodes,); increased by this call.
    """
    comm = slave.comm
    keys = np.column_stack([node.astype(np.float64), np.round(places, 6)])
    to = [np.flatnonzero(owner == rank) for rank in range(comm.size)]
    came = comm.alltoall([keys[some] for some in to])
    here = np.concatenate(came)
    order = np.lexsort(here.T[::-1])
    begins = np.searchsorted(here[order, 0], here[:, 0], side="left")
    ends = np.searchsorted(here[order, 0], here[:, 0], side="right")
    place = np.empty(len(here), dtype=np.int64)
    place[order] = np.arange(len(here))
    at = np.searchsorted(slave.node_dofs[:, 0], here[:, 0])
    answers = np.column_stack([taken[at] + place - begins, ends - begins])
    np.add.at(taken, at, 1)
    back = comm.alltoall(np.split(answers, np.cumsum([len(part) for part in came])[:-1]))
    out = np.zeros((len(node), 2), dtype=np.int64)
    for some, values in zip(to, back, strict=True):
        out[some] = values
    return out


def linear(surface: Surface, values: Array) -> Array:
    """Linear functions of the vertices at points, from given values of the trace functions."""
    count = surface.num_facet_vertices
    out = values[:, :count].copy()
    if values.shape[1] > count:
        for at, ends in enumerate(EDGES[count], start=count):
            out[:, ends] += values[:, at, None] / 2
        out += values[:, count + len(EDGES[count]) :].sum(axis=1, keepdims=True) / count
    return out
