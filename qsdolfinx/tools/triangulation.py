"""Create the facets of rigid tools from arrays and meshes."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import check_vector, require
from qsdolfinx.base.collective import checked
from qsdolfinx.compat import cell_nodes, coordinate_element
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.tools.touching import separate

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Facets:
    """This rank's facets of a tool, at its initial position.

    Attributes:
        x: Vertex coordinates, shape (facets, vertices, 3).
        vertices: Global numbers of the vertices, shape (facets, vertices).
        owner: Ranks that own the vertices, of the same shape.
        num_owned: Number of vertices that this rank owns, a contiguous range.
        sign: −1 where a facet's orientation must be reversed, else 1, shape (facets,).
    """

    x: Array
    vertices: Indices
    owner: npt.NDArray[np.int32]
    num_owned: int
    sign: Array

    def surface(
        self, comm: MPI.Intracomm, gdim: int, R: Array, t: Array, axisymmetric: bool
    ) -> _cpp.Surface:
        """The surface after x ↦ R x + t; the vertices get fictitious unknowns. Collective."""
        x = self.x @ R.T + t
        return _cpp.Surface(
            comm=comm.py2f(),
            gdim=gdim,
            block=gdim,
            num_vertices=x.shape[1],
            x=np.ascontiguousarray(x),
            degree=1,
            dofs=self.dofs(gdim),
            owner=np.ascontiguousarray(self.owner),
            inside=np.ascontiguousarray(self.behind(x)),
            local_size=self.num_owned * gdim,
            axisymmetric=axisymmetric,
        )

    def dofs(self, gdim: int) -> Indices:
        """Fictitious unknowns of the vertices, shape (facets, vertices, gdim)."""
        return np.ascontiguousarray(self.vertices[..., None] * gdim + np.arange(gdim))

    def behind(self, x: Array) -> Array:
        """Points behind the facets, for other vertex coordinates, shape (facets, 3)."""
        return np.asarray(x.mean(axis=1) - self.sign[:, None] * area_vectors(x))


def scatter(
    comm: MPI.Intracomm,
    x: npt.ArrayLike | None,
    triangles: npt.ArrayLike | None,
    center: npt.ArrayLike | None,
    name: str = "triangles",
) -> tuple[Facets, Array]:
    """Distribute rank 0's facets over the ranks, as DOLFINx does with cells. Collective.

    Args:
        comm: Communicator of the tool.
        x: Vertices, shape (vertices, gdim).
        triangles: Indices of the vertices of each facet, shape (facets, gdim).
        center: What the tool is rotated about, shape (gdim,), or None.
        name: Name of the argument in errors about the facets.

    Returns:
        The facets of this rank, and the center or else the mean vertex, shape (gdim,).
    """
    points: Array = np.zeros((0, 3))
    cells: Indices = np.zeros((0, 3), dtype=np.int64)
    digests = _digest(x), _digest(triangles)
    first = comm.bcast(digests, root=0)
    with checked(comm) as same:
        if comm.rank == 0 or x is not None or triangles is not None:
            points, cells = _checked(x, triangles)
            first = digests
        same(x=first[0], triangles=first[1])
    gdim = comm.bcast(points.shape[1], root=0)
    if comm.rank > 0:
        points, cells = np.zeros((0, gdim)), np.zeros((0, gdim), dtype=np.int64)
    # Solids are separated first: the treatment of an edge of three triangles depends on the version
    # of DOLFINx.
    if gdim == 3 and comm.rank == 0:
        points, cells = separate(points, cells)
    _check_orientation(comm, name, cells, padded(points)[cells], np.ones(len(cells)))
    kind = "interval" if gdim == 2 else "triangle"
    element = basix.ufl.element("Lagrange", kind, 1, shape=(gdim,))
    msh = mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element))
    return of_mesh(msh, None, center)


def _digest(array: npt.ArrayLike | None) -> str:
    """Digest of an array; accepts any object, because arrays are checked only later."""
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        return hashlib.blake2b(np.asarray(array, dtype=np.float64).tobytes()).hexdigest()
    return ""


def _checked(x: npt.ArrayLike | None, triangles: npt.ArrayLike | None) -> tuple[Array, Indices]:
    """The arrays, or an exception that names the wrong argument."""
    try:
        points = np.array(x, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.zeros(0)
    fits = points.ndim == 2 and points.shape[1] in (2, 3)
    require(fits, "x: must be an array of the shape (vertices, 2 or 3)")
    require(np.isfinite(points).all(), "x: coordinates are not finite (NaN, infinity)")
    given = np.asarray(triangles)
    gdim = points.shape[1]
    fits = given.ndim == 2 and given.shape[1] == gdim and np.issubdtype(given.dtype, np.integer)
    require(fits, f"triangles: must be integers of the shape (facets, {gdim})")
    require(len(given), "triangles: there are none")
    fits = given.min() >= 0 and given.max() < len(points)
    require(fits, f"triangles: indices must be from 0 to {len(points) - 1}")
    cells = given.astype(np.int64)
    check_areas("triangles", padded(points)[cells])
    return points, cells


def padded(x: Array) -> Array:
    """Points with three coordinates, shape (n, 3)."""
    return np.column_stack([x, np.zeros((len(x), 3 - x.shape[1]))])


def without_area(x: Array) -> npt.NDArray[np.bool_]:
    """Flags of facets without area, x of shape (facets, vertices, 3)."""
    size = np.max(np.linalg.norm(x[:, :, None] - x[:, None, :], axis=-1), axis=(1, 2), initial=0.0)
    power = 1 if x.shape[1] == 2 else 2
    return np.asarray(~(np.linalg.norm(area_vectors(x), axis=1) > 1e-14 * size**power))


def check_areas(name: str, x: Array) -> None:
    """Raise an error for facets without area."""
    flat = without_area(x)
    require(not flat.any(), f"{name}: {np.count_nonzero(flat)} facets have no area")


def _check_orientation(
    comm: MPI.Intracomm, name: str, vertices: Indices, x: Array, sign: Array
) -> None:
    """Raise an error for neighbours of opposite orientation. Collective.

    Facets with the same orientation traverse their common edge once in each direction. Segments
    with the same orientation leave and reach a vertex once.

    Args:
        comm: Communicator of the tool.
        name: Name of the argument in the error.
        vertices: Global numbers of the vertices, shape (facets, vertices).
        x: Coordinates of the vertices, shape (facets, vertices, 3).
        sign: −1 where a facet's orientation must be reversed, else 1, shape (facets,).
    """
    n = vertices.shape[1]
    ring = [0, 1, 3, 2] if n == 4 else [*range(n)]
    turned = np.where(sign[:, None] < 0, vertices[:, ring[::-1]], vertices[:, ring])
    if n == 2:
        passed = np.concatenate([turned[:, [i, i]] * [1, 0] + [0, i] for i in range(2)])
    else:
        passed = np.stack([turned, np.roll(turned, -1, axis=1)], axis=-1).reshape(-1, 2)
    to = passed.min(axis=1) % comm.size if n > 2 else passed[:, 0] % comm.size
    received = np.concatenate(comm.alltoall([passed[to == rank] for rank in range(comm.size)]))
    found, count = np.unique(received, axis=0, return_counts=True)
    repeated = [tuple(pair) for pair in found[count > 1][:1].tolist()]
    first = min((pair for pairs in comm.allgather(repeated) for pair in pairs), default=None)
    if first is None:
        return
    ends = [number for number in first if n > 2] or [first[0]]
    mine = {number: x[vertices == number][:1].tolist() for number in ends}
    known = comm.allgather(mine)
    places = [next(at[number][0] for at in known if at[number]) for number in ends]
    texts = ["({:.6g}, {:.6g}, {:.6g})".format(*place) for place in places]
    kind, remedy = "edge from " + " to ".join(texts), "its facets must pass it in opposite ways"
    if n == 2:
        kind, remedy = f"vertex {texts[0]}", "one segment must begin at it, the other end there"
    raise ValueError(
        f"{name}: neighbours at the {kind} have opposite orientations, or overlap; {remedy}: "
        "reverse facets, remove repeated facets, and unite solids that overlap, or make each of "
        "them a tool of its own"
    )


def of_mesh(
    msh: mesh.Mesh, inside: npt.ArrayLike | None, center: npt.ArrayLike | None
) -> tuple[Facets, Array]:
    """This rank's cells of a surface mesh, and the center or else the mean vertex. Collective.

    Args:
        msh: The mesh.
        inside: A point from which all cells are oriented away; without it, orientations are kept.
        center: What the tool is rotated about, shape (gdim,), or None.
    """
    comm, geometry, tdim = msh.comm, msh.geometry, msh.topology.dim
    gdim = int(geometry.dim)
    with checked(comm) as same:
        fits = gdim in (2, 3) and tdim == gdim - 1
        require(fits, f"msh: must have the topological dimension gdim - 1, not {tdim}")
        require(coordinate_element(msh).degree == 1, "msh: must be of first order")
        cells = cell_nodes(msh)[: msh.topology.index_map(tdim).size_local]
        x = np.asarray(geometry.x[cells], dtype=np.float64)
        require(np.isfinite(x).all(), "msh: coordinates are not finite (NaN, infinity)")
        check_areas("msh", x)
        sign: Array = np.ones(len(x))
        if inside is not None:
            point = np.append(check_vector("inside", inside, gdim), np.zeros(3 - gdim))
            same(inside=point)
            outward = np.sum((x.mean(axis=1) - point) * area_vectors(x), axis=1)
            sign = np.where(outward < 0, -1.0, 1.0)
        middle = None if center is None else check_vector("center", center, gdim)
        same(center=middle)
    index_map = geometry.index_map()
    owners = np.concatenate(
        [np.full(index_map.size_local, comm.rank, dtype=np.int32), index_map.owners]
    )
    vertices = index_map.local_to_global(cells.ravel()).reshape(cells.shape).astype(np.int64)
    _check_orientation(comm, "msh", vertices, x, sign)
    total = comm.allreduce(geometry.x[: index_map.size_local, :gdim].sum(axis=0), op=MPI.SUM)
    facets = Facets(x, vertices, owners[cells].astype(np.int32), int(index_map.size_local), sign)
    mean = typing.cast(Array, total / index_map.size_global)
    return facets, mean if middle is None else middle
