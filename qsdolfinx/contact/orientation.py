"""Check for tools whose facets have the wrong orientation, so that opposite walls are paired."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Least part of the slave's facets near the tool for which a tool with reversed facets appears
#: reversed. With less, free sides, or facets at a corner, which may be near another wall, would
#: raise the alarm; with all, one facet at a corner would prevent it.
MOST = 0.9

#: Distance of the partner over that of the wall that faces away, above which a tool appears
#: reversed. A point that has penetrated a wall belongs to the side through which it entered, up to
#: the opposite side.
FURTHER = 3.0

#: Part of a facet's size within which the facet almost touches a wall. With much more, facets
#: beside a reversed tool, which face its inside, count as well.
CLOSE = 0.5

#: Extent of the body over the depth of its facets below a wall, if a cavity is around it. A larger
#: body is not entirely within the cavity: with much more, each body beside a thin wall would be.
WITHIN = 2.0


def find_turned(model: ContactModel) -> str:
    """Warning if the first contact detection is that of a reversed tool; else empty. Collective.

    A surface of facets bounds the material on one of its sides, and only its orientation determines
    which side. If a closed surface has the wrong orientation, the wrong wall is paired. A body that
    touches or penetrates a tool is paired with the tool's far side in front of it, and a body in a
    cavity with the cavity's far side behind it. Nearer to the body there is a wall that faces away.
    Each connected shell has its own orientation: a file may contain several shells with one
    reversed.
    """
    tools = [tool for tool in model.master.tools if not tool.is_analytic]
    return "".join(_turned_shell(model, tool) for tool in tools)


def _turned_shell(model: ContactModel, tool: RigidSurface) -> str:
    """Warning about a reversed shell of a tool made of facets; else empty. Collective."""
    slave, radius = model.slave.linear, model.paired.search_radius
    other = tool.search_object(slave)
    x, inside, _ = slave.coordinates
    middle, area = x.mean(axis=1), area_vectors(x)
    size = np.linalg.norm(area, axis=1)
    away = np.sum((inside - middle) * area, axis=1)
    normal = -np.copysign(1.0, away)[:, None] * area / size[:, None]
    depth = np.abs(away) / size
    partner, of_partner = _offsets(slave.cpp_object, other, middle, normal, radius)
    slave.cpp_object.move(x, 2 * middle - inside)
    wall, of_wall = _offsets(slave.cpp_object, other, middle, -normal, radius)
    wall = -wall
    slave.cpp_object.move(x, inside)
    low, high = _box(model)
    extent = np.sum(normal * middle - np.minimum(normal * low, normal * high), axis=1)
    has_partner = ~np.isnan(partner)
    with np.errstate(invalid="ignore"):  # NaN where there is no partner
        further = np.abs(partner) > FURTHER * np.abs(wall)
        # A sheet in a cavity has all of its cells in front of the wall on which it lies, and a body
        # that penetrates a plate is not entirely within the plate.
        of_tool = (partner > 0) & (wall >= -depth)
        of_cavity = (partner < 0) & (-partner > depth) & (extent <= WITHIN * -partner)
        turned = np.where(has_partner, further & (of_tool | of_cavity), np.abs(wall) <= depth)
    near = turned | has_partner
    shells = tool.shells()
    shell = shells.at(np.where(turned, of_wall, of_partner)[near] // tool.gdim)
    # Facets that almost touch are the best indicator: facets beside a reversed tool face its
    # inside.
    close = np.fmin(np.abs(partner), np.abs(wall))[near] <= CLOSE * _sizes(size, tool.gdim)[near]
    counts = _count(model.comm, shell, turned[near])
    counts |= _count(model.comm, shell[close], turned[near][close])
    for name, (num_turned, num_near) in sorted(counts.items()):
        if num_turned >= MOST * num_near > 0:
            return _text(num_turned, num_near, *shells.extent(name))
    return ""


def _sizes(area: Array, gdim: int) -> Array:
    """Lengths of facets with these areas."""
    return area if gdim == 2 else np.sqrt(area)


def _count(comm: MPI.Intracomm, shell: Indices, turned: Flags) -> dict[int, tuple[int, int]]:
    """Numbers of facets near each shell, on all ranks: apparently reversed, and all. Collective."""
    names, index = np.unique(shell, return_inverse=True)
    local = np.bincount(index, turned, len(names)), np.bincount(index, minlength=len(names))
    out: dict[int, tuple[int, int]] = {}
    for found in comm.allgather((names, *local)):
        for name, some, near in zip(*found, strict=True):
            before = out.get(int(name), (0, 0))
            out[int(name)] = before[0] + int(some), before[1] + int(near)
    return out


def _text(num_turned: int, num_near: int, num_facets: int, low: Array, high: Array) -> str:
    """Warning about one shell."""
    low_text, high_text = (", ".join(f"{c:.4g}" for c in corner) for corner in (low, high))
    return (
        f"normals: {num_turned} of {num_near} slave facets near one connected shell of the tool "
        f"({num_facets} facets, made from ({low_text}) to ({high_text})) are beside a wall that "
        "faces away from them, and have an opposite wall as a partner, or none: the shell's "
        "orientation seems to be that of a solid instead of a cavity, or the reverse, or the "
        "slave's facets are on the wrong side of the body. The tool's normals must point to the "
        "workpiece: reverse the shell's facets (triangles[:, ::-1], or in the program that wrote "
        "the file), or give from_mesh a point inside=... on the other side"
    )


def _box(model: ContactModel) -> tuple[Array, Array]:
    """Corners of the smallest box around the slave's body. Collective."""
    x = model.slave.mesh.geometry.x
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high]).astype(np.float64)
    model.comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    return -corners[:3], corners[3:]


def _offsets(
    own: _cpp.Surface, other: _cpp.Surface, x: Array, normal: Array, radius: float
) -> tuple[Array, Indices]:
    """Distances of partners of points along the normals, and first unknowns of their facets.

    Distances are negative behind the point, and NaN without a partner.
    """
    closest = _cpp.closest_points(x, np.ascontiguousarray(normal), own, other, radius)
    along = np.sum((closest["x"] - x) * normal, axis=1)
    return np.where(closest["found"].astype(bool), along, np.nan), closest["dofs"][:, 0, 0]
