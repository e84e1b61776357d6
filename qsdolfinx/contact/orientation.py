"""Tools whose facets are oriented the wrong way, and so are paired with their opposite walls."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.tools.rigid_surface import as_tool

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Part of the slave's facets near the tool that it looks turned to if it is. Free sides, or facets
#: at a corner, may be near another wall.
MOST = 0.9

#: How many times further than the wall that looks away the partner is then. A point that has gone
#: into a wall belongs to the side it came in by, up to the other one.
FURTHER = 3.0

#: Part of a facet's size within which it all but touches a wall.
CLOSE = 0.5

#: Extent of the body over the depth of its facets below a wall, if a cavity is around it.
WITHIN = 2.0


def find_turned(model: ContactModel) -> str:
    """What is to be warned of if the first pairing is that of a turned tool. Collective.

    A surface of facets stands for what is on one side of it, and only its orientation says which.
    Oriented the wrong way, a closed one has a wall in the place of the opposite one: a body that
    touches, or has gone into, a tool finds the tool's far side in front of it, and one in a cavity
    the cavity's far side behind it. Nearer to it there is a wall that looks away. Each connected
    shell has an orientation of its own: a file may hold several, and one of them turned.
    """
    tool = as_tool(model.master)
    if tool is None or tool.is_analytic:
        return ""
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
    with np.errstate(invalid="ignore"):  # NaN where there is none
        further = np.abs(partner) > FURTHER * np.abs(wall)
        # A sheet that lies in a cavity has all of its cells before the wall that it lies on, and a
        # body that has gone into a plate is not all within that.
        of_tool = (partner > 0) & (wall >= -depth)
        of_cavity = (partner < 0) & (-partner > depth) & (extent <= WITHIN * -partner)
        turned = np.where(has_partner, further & (of_tool | of_cavity), np.abs(wall) <= depth)
    near = turned | has_partner
    shells = tool.shells()
    shell = shells.at(np.where(turned, of_wall, of_partner)[near] // tool.gdim)
    # Those that all but touch tell most: what is beside a tool sees its inside if it is turned.
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
    """Facets of all ranks near each shell that look turned, and that are near. Collective."""
    names, index = np.unique(shell, return_inverse=True)
    local = np.bincount(index, turned, len(names)), np.bincount(index, minlength=len(names))
    out: dict[int, tuple[int, int]] = {}
    for found in comm.allgather((names, *local)):
        for name, some, near in zip(*found, strict=True):
            before = out.get(int(name), (0, 0))
            out[int(name)] = before[0] + int(some), before[1] + int(near)
    return out


def _text(num_turned: int, num_near: int, num_facets: int, low: Array, high: Array) -> str:
    """The warning of one shell."""
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
    """How far partners of points are away along the normals, and first unknowns of their facets.

    Negative behind; NaN for none.
    """
    closest = _cpp.closest_points(x, np.ascontiguousarray(normal), own, other, radius)
    along = np.sum((closest["x"] - x) * normal, axis=1)
    return np.where(closest["found"].astype(bool), along, np.nan), closest["dofs"][:, 0, 0]
