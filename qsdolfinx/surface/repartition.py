"""Repartitioning of a mesh, to share the work of contact between ranks."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import graph, io, mesh

from qsdolfinx import compat
from qsdolfinx.base.checks import MESH, TAGS, check, check_array, require
from qsdolfinx.base.collective import checked
from qsdolfinx.surface.arguments import is_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

#: Part of the coordinates that is added to distinguish cells of the same layer.
_SKEW = 1e-6 / np.pi ** np.arange(3)


def repartition(
    msh: mesh.Mesh, directions: npt.ArrayLike, *tags: mesh.MeshTags
) -> tuple[typing.Any, ...]:
    """Distribute a mesh anew, partitioned by planes normal to given directions. Collective.

    The cells are divided into two halves in the direction of their largest extent, and the halves
    again, until there is a part for each rank (recursive coordinate bisection: Berger & Bokhari,
    1987); the numbers of cells of the parts differ by one at most. With directions that lie in the
    contact surface, each rank has a part of this surface and of the surface opposite. A graph
    partition, in contrast, may cut a body along the contact surface, and give all of the surface to
    a few ranks.

    Args:
        msh: Mesh with one cell type.
        directions: Vectors normal to the cutting planes, shape (n, gdim).
        tags: Tags of cells, facets, edges or vertices of the mesh.

    Returns:
        The mesh without ghost cells, and the tags on it, with their names: always a tuple,
        ``(msh,)`` without tags.

    Raises:
        ValueError: If there is no direction, a direction is zero or of another dimension, or tags
            belong to another mesh.
        TypeError: If ``msh`` is not a mesh, or tags are of another type.
    """
    check(MESH, msh=msh)
    with checked(msh.comm) as same:
        towards = _checked(msh, directions, tags)
        same(directions=towards)
    count = msh.topology.index_map(msh.topology.dim).size_local
    nodes = compat.cell_nodes(msh)[:count]
    gdim, owned = msh.geometry.dim, msh.geometry.index_map().size_local
    middles = msh.geometry.x[nodes][:, :, :gdim].mean(axis=1)
    ranks = _halve(msh.comm, middles, towards)

    def partition(comm: MPI.Comm, size: int, *_: typing.Any) -> typing.Any:
        lists = graph.adjacencylist(ranks, np.arange(count + 1, dtype=np.int32))
        return getattr(lists, "_cpp_object", lists)

    new = mesh.create_mesh(
        msh.comm,
        cells=_global(msh, nodes),
        x=msh.geometry.x[:owned, :gdim].copy(),
        e=ufl.Mesh(msh.ufl_domain().ufl_coordinate_element()),
        partitioner=partition,
    )
    new.name = msh.name
    return new, *(_moved(msh, new, tag) for tag in tags)


def _checked(
    msh: mesh.Mesh, directions: npt.ArrayLike, tags: typing.Sequence[mesh.MeshTags]
) -> Array:
    """Check the arguments, and return the directions as unit vectors."""
    for tag in tags:
        check(TAGS, tags=tag)
        require(is_of(tag, msh), "tags: must be tags of msh")
    vectors = check_array("directions", directions, (None, msh.geometry.dim))
    lengths = np.linalg.norm(vectors, axis=1)
    fits = len(vectors) > 0 and np.isfinite(lengths).all() and (lengths > 0).all()
    require(fits, "directions: must be at least one finite vector, none of them zero")
    return np.asarray(vectors / lengths[:, None])


def _global(msh: mesh.Mesh, nodes: Indices) -> npt.NDArray[np.int64]:
    """Global numbers of nodes of the mesh's geometry."""
    numbers = msh.geometry.index_map().local_to_global(nodes.ravel())
    return np.asarray(numbers, dtype=np.int64).reshape(nodes.shape)


def _halve(comm: MPI.Comm, x: Array, directions: Array) -> Indices:
    """Assign a rank to each point x, in groups of equal size. Collective.

    A group of points belongs to ranks [first, end), and is identified by the first of them.
    """
    along = x @ directions.T
    skew = x @ _SKEW[: x.shape[1]]
    first: Indices = np.zeros(len(x), dtype=np.int32)
    ends = np.zeros(comm.size, dtype=np.int32)
    ends[0] = comm.size
    while np.any(ends - np.arange(comm.size) > 1):
        middles = (np.arange(comm.size) + ends) // 2
        low, high = (np.full((comm.size, len(directions)), s) for s in (np.inf, -np.inf))
        np.minimum.at(low, first, along)
        np.maximum.at(high, first, along)
        comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
        comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
        axis = np.argmax(high - low, axis=1)[first]
        value = along[np.arange(len(x)), axis] + skew
        upper = value > _cuts(comm, value, first, middles, ends)[first]
        first = np.where(upper, middles[first], first).astype(np.int32)
        split = np.flatnonzero(ends - np.arange(comm.size) > 1)
        ends[middles[split]] = ends[split]
        ends[split] = middles[split]
    return first


def _cuts(
    comm: MPI.Comm,
    value: Array,
    first: Indices,
    middles: Indices,
    ends: Indices,
) -> Array:
    """Values that split each group: the part of its points below goes to its lower ranks."""
    size = comm.size
    total = comm.allreduce(np.bincount(first, minlength=size), op=MPI.SUM)
    ranks = np.maximum(ends - np.arange(size), 1)
    wanted = total * np.maximum(middles - np.arange(size), 0) / ranks
    low: Array = np.full(size, comm.allreduce(value.min(initial=np.inf), op=MPI.MIN))
    high: Array = np.full(size, comm.allreduce(value.max(initial=-np.inf), op=MPI.MAX))
    for _ in range(np.finfo(np.float64).nmant + 8):  # to rounding of the range of values
        cut = (low + high) / 2
        local = np.bincount(first[value <= cut[first]], minlength=size)
        below = comm.allreduce(local, op=MPI.SUM) >= wanted
        low, high = np.where(below, low, cut), np.where(below, cut, high)
    return high


def _moved(msh: mesh.Mesh, new: mesh.Mesh, tag: mesh.MeshTags) -> mesh.MeshTags:
    """Transfer the tags of a mesh to the repartitioned mesh. Collective."""
    dim, tdim = tag.dim, msh.topology.dim
    for other in (0, tdim):
        for made in (msh, new):
            made.topology.create_connectivity(dim, other)
            made.topology.create_connectivity(other, dim)
    layout = compat.coordinate_element(msh).create_dof_layout()
    nodes: Indices = np.empty((0, len(layout.entity_closure_dofs(dim, 0))), dtype=np.int32)
    if len(tag.indices) > 0:  # DOLFINx divides by the number of entities
        nodes = mesh.entities_to_geometry(msh, dim, tag.indices)
    # Ranks that share an entity may all have sent it.
    entities, values = io.utils.distribute_entity_data(new, dim, _global(msh, nodes), tag.values)
    lists = graph.adjacencylist(entities)
    twice = mesh.meshtags_from_entities(new, dim, lists, values)
    indices, places = np.unique(twice.indices, return_index=True)
    moved = mesh.meshtags(new, dim, indices, twice.values[places])
    moved.name = tag.name
    return moved
