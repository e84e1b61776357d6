"""Vertices at creases: places where an edge or corner goes ahead of all quadrature points."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.affine import EDGES
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.facet_surface import FacetSurface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Unknowns, owners and trace functions of a tool.
NOTHING = (
    np.zeros(0, dtype=np.int64),
    np.zeros(0, dtype=np.int32),
    np.zeros(0),
)

#: What has facets: a body's surface, or a tool's read as one.
Faceted = Surface | FacetSurface

#: Sum of the normals of a node's facets over their number, of facets that turn by 30° there.
SMOOTH = float(np.cos(np.pi / 12))

#: Cosine of the angle (0.5°) up to which a facet is parallel to what is opposite: its own points
#: see what comes.
FLAT = float(np.cos(np.pi / 360))

#: Part of a facet's size by which it may lead towards what is opposite: rounding.
ROUNDING = 1e-9


def has_creases(surface: AnySurface, asked: bool) -> bool:
    """Whether a surface has sharp vertices, if that is asked. Collective."""
    if not asked or surface.is_analytic:
        return False
    sharp = sharp_nodes(as_facets(surface))
    return bool(surface.comm.allreduce(bool(sharp.any()), op=MPI.LOR))


def as_facets(surface: AnySurface, axisymmetric: bool = False) -> Faceted:
    """A surface made of facets: the body's itself, or a tool's read as one. Collective.

    Args:
        surface: The surface.
        axisymmetric: Whether a tool's facets stand for rings.
    """
    return surface.as_facets(axisymmetric) if isinstance(surface, RigidSurface) else surface


def sharp_nodes(surface: Faceted) -> Flags:
    """Owned nodes whose facets' normals are apart by more than some 30°. Collective."""
    normals = _normals_at_vertices(surface).reshape(-1, 3)
    ones = np.ones(len(normals))
    sums = np.array([_sums(surface, values) for values in (*normals.T, ones)])
    return np.asarray(np.linalg.norm(sums[:3], axis=0) < SMOOTH * sums[3])


class VerticesRole(typing.NamedTuple):
    """Whose vertices face what.

    Attributes:
        slave: Surface that carries the multipliers.
        master: The other one, or a rigid tool.
        of_tool: Whether they are the tool's; else the slave's.
    """

    slave: Surface
    master: AnySurface
    of_tool: bool


def pair_vertices(role: VerticesRole, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Points at sharp vertices that are ahead of their facets. Collective.

    A vertex faces the closest place on the other surface, along the normal there. It counts if the
    middles of all facets beside it are further away, and none is parallel to the other surface up
    to 0.5°: their own points are as close as it is, and what it adds would be redundant.

    A tool has no multipliers: a point at its vertex has that of the slave's vertex next to it.

    Args:
        role: Whose they are.
        radius: Beyond which points are not paired.
    """
    if role.of_tool:
        return _of_tool(role.slave, role.master, radius)
    return _of_slave(role.slave, role.master, radius)


def _of_slave(slave: Surface, master: AnySurface, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Vertices of the slave; see :func:`pair_vertices`."""
    which = sharp_nodes(slave).astype(np.uint8)
    tool = as_tool(master)
    if tool is not None and tool.is_analytic:
        points = _cpp.sample_vertices(slave.cpp_object, which)
        gap, normal = tool.distance(points.slave["x"])
        near = (np.abs(gap) <= radius.largest) & (np.sum(normal * points.normal, axis=1) < 0)
        _cpp.face_tool(points, near.astype(np.uint8), -normal, gap, 1)
    else:
        other = master.search_object(slave)
        points = _cpp.pair_vertices(slave.cpp_object, other, which, radius)
        if tool is not None:
            _cpp.forget_master(points)
    _cpp.keep_points(points, _lead_away(slave, points).astype(np.uint8))
    return points


def _of_tool(slave: Surface, tool: AnySurface, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Vertices of a tool: points on the slave's facets opposite; see :func:`pair_vertices`."""
    of_tool = as_facets(tool, slave.axisymmetric)
    which = sharp_nodes(of_tool).astype(np.uint8)
    found = _cpp.pair_vertices(of_tool.cpp_object, slave.cpp_object, which, radius)
    _cpp.keep_points(found, _lead_away(of_tool, found).astype(np.uint8))
    at, on_tool = found.master, found.slave
    functions = _linear(slave, at["shape_values"])
    next_to = np.zeros_like(functions)
    next_to[np.arange(len(next_to)), functions.argmax(axis=1)] = 1.0
    nodes = np.ascontiguousarray(at["dofs"][:, : slave.num_facet_vertices, 0])
    area = _gathered(slave, slave.node_area, nodes)
    return _cpp.points_between(
        slave.cpp_object,
        None,
        at["x"],
        at["dofs"],
        at["owner"],
        at["shape_values"],
        on_tool["x"],
        *NOTHING,
        next_to,
        -found.normal,
        found.gap,
        np.sum(functions * area, axis=1),
    )


def _linear(surface: Surface, values: Array) -> Array:
    """Linear functions of the vertices at points with given functions of the trace."""
    count = surface.num_facet_vertices
    out = values[:, :count].copy()
    if values.shape[1] > count:
        for at, ends in enumerate(EDGES[count], start=count):
            out[:, ends] += values[:, at, None] / 2
        out += values[:, count + len(EDGES[count]) :].sum(axis=1, keepdims=True) / count
    return out


def _lead_away(slave: Faceted, points: _cpp.PairingPoints) -> Flags:
    """Points at nodes whose facets all lead away from what is opposite. Collective."""
    node = np.searchsorted(slave.node_dofs[:, 0], points.slave["dofs"][:, 0, 0])
    normal = np.zeros((len(slave.node_area), 3))
    normal[node] = points.normal
    x = slave.coordinates[0]
    opposite = np.stack([_at_vertices(slave, values) for values in normal.T], axis=2)
    inward = x.mean(axis=1, keepdims=True) - x
    size = np.linalg.norm(inward, axis=2)
    ahead = np.sum(inward * opposite, axis=2) > ROUNDING * size
    flat = np.sum(_normals_at_vertices(slave) * opposite, axis=2) > FLAT
    stays = (ahead | flat).astype(np.float64)
    return np.asarray(_sums(slave, stays.ravel())[node] == 0)


def _normals_at_vertices(surface: Faceted) -> Array:
    """Outward unit normals of the facets, curved as their mesh is, (facets, vertices, 3)."""
    x, inside, nodes = surface.coordinates
    count = surface.num_facet_vertices
    tangents: list[list[Array]] = [[] for _ in range(count)]
    for at, (i, j) in enumerate(EDGES[count], start=count):
        middle = (x[:, i] + x[:, j]) / 2 if nodes is None else nodes[:, at]
        tangents[i].append(4 * middle - 3 * x[:, i] - x[:, j])
        tangents[j].append(4 * middle - 3 * x[:, j] - x[:, i])
    out = np.empty_like(x)
    for i, (along, *others) in enumerate(tangents):
        across = others[0] if others else np.broadcast_to([0.0, 0.0, 1.0], along.shape)
        out[:, i] = np.cross(along, across)
    outward = x.mean(axis=1) - inside
    out *= np.sign(np.sum(outward[:, None] * out, axis=2))[..., None]
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=2), 1e-300)[..., None])


def _vertex_dofs(surface: Faceted) -> npt.NDArray[np.int32]:
    """First unknowns of the vertices of the facets, (facets, vertices)."""
    dofs = surface.cpp_object.facet_dofs[:, : surface.num_facet_vertices, 0]
    return np.ascontiguousarray(dofs.astype(PETSc.IntType))


def _sums(surface: Faceted, values: Array) -> Array:
    """Sums over the facets of values of their vertices, (facets · vertices,), at owned nodes."""
    vec = surface.create_vec()
    vec.setValues(_vertex_dofs(surface).ravel(), values, addv=PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: Array = vec.array_r[surface.node_dofs[:, 0] - vec.owner_range[0]].copy()
    vec.destroy()
    return out


def _at_vertices(surface: Faceted, values: Array) -> Array:
    """Values of the owned nodes at the vertices of the facets, (facets, vertices)."""
    return _gathered(surface, values, _vertex_dofs(surface))


def _gathered(surface: Faceted, values: Array, dofs: npt.NDArray[np.integer]) -> Array:
    """Values of the owned nodes at nodes given by their first unknowns. Collective."""
    vec = surface.create_vec()
    vec.array[surface.node_dofs[:, 0] - vec.owner_range[0]] = values
    local = PETSc.Vec().createSeq(dofs.size)
    here = PETSc.IS().createGeneral(dofs.ravel().astype(PETSc.IntType), PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, here, local, None)
    scatter.scatter(vec, local)
    out: Array = local.array_r.reshape(dofs.shape).copy()
    for thing in (vec, local, here, scatter):
        thing.destroy()
    return out
