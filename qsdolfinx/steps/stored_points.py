"""Store the friction state of points in a checkpoint, with keys for any partition."""

from __future__ import annotations

import functools

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction import carried
from qsdolfinx.friction.of_points import OfPoints, closest
from qsdolfinx.friction.slip import Slip
from qsdolfinx.steps.checkpoint import Checkpoint, StoredPoints, vertex_unknowns
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.facet_surface import FacetSurface

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def stored_points(slip: Slip) -> tuple[Indices, Array]:
    """Keys of the points of a slip, with their positions, rest and normals. Collective.

    With updated geometry, the points are those at the end of the last step.
    """
    if slip.gap.following is not None:
        kept = slip.state.of_points
        if kept is None:
            kept = _now(slip)
        keys, place = _numbered(slip, kept.keys, kept.place)
        some = ~_is_alone(kept.keys)
        return keys[some], np.column_stack([place, kept.rest, kept.normal])[some]
    keys, place = _known_by(slip)
    of_points = carried.of_points(slip, keys, place)
    return keys, np.column_stack([place, of_points.rest, of_points.normal])


def load_points(slip: Slip, normals: Array, checkpoint: Checkpoint, name: str) -> None:
    """Load the values of a slip's points from a checkpoint. Collective.

    Args:
        slip: Slip with constraints at points; its nodes already have their multipliers.
        normals: Saved nodal normals, see ``carried.normals_of_nodes``.
        checkpoint: The checkpoint.
        name: Name of the stored points.
    """
    points = checkpoint.points(name)
    if points is None:
        return
    if slip.gap.following is None:
        carried.show_saved(slip, *_saved(points, slip))
        slip.state.saved = functools.partial(_take_saved, points, normals)
        return
    now = _now(slip)
    keys, place = _numbered(slip, now.keys, now.place)
    old = _of_points(slip, *points.find(keys))
    at = closest(old.keys, old.place, keys, place)
    now.rest[at >= 0] = old.rest[at[at >= 0]]
    slip.state.of_points = now


def _take_saved(points: StoredPoints, normals: Array, slip: Slip) -> None:
    """Transfer saved values to a slip of new contact pairs. Collective."""
    carried.take(slip, normals, *_saved(points, slip))


def _saved(points: StoredPoints, slip: Slip) -> tuple[OfPoints, Indices, Array]:
    """Saved points between the facets of a slip's points; keys and positions of these. Collective.

    Contact pairs of the end of the run are not those of its last contact detection, nor those of
    the next step: for both, the points come from the saved ones.
    """
    keys, place = _known_by(slip)
    return _of_points(slip, *points.find(keys)), keys, place


def _of_points(slip: Slip, keys: Indices, values: Array) -> OfPoints:
    """Stored points from their keys and values."""
    ends = np.cumsum([slip.gap.slave.num_facet_vertices, slip.gap.slave.gdim])
    return OfPoints(keys, *np.split(values, ends, axis=1))


def _now(slip: Slip) -> OfPoints:
    """Points of gaps with updated geometry at present positions, without any rest. Collective."""
    assert slip.gap.cut is not None
    at = slip.gap.slip_at_points(slip.gap.cut.places)
    return OfPoints(at.facets, at.place, np.zeros_like(at.slip), at.normal)


def _is_alone(keys: Indices) -> npt.NDArray[np.bool_]:
    """Flags of points that do not lie between facets."""
    return np.asarray(np.all(keys == -1, axis=1))


def _numbered(slip: Slip, keys: Indices, place: Array) -> tuple[Indices, Array]:
    """As :func:`_known_by`, for the keys of ``SlipAtPoints``. Collective."""
    slave, master = slip.gap.slave, slip.gap.master
    nv = slave.num_facet_vertices
    first = 0 if keys.shape[1] == nv else 1  # the segmented facet, except for analytic tools
    numbers = _numbers(slave, keys[:, first : first + nv, None])
    order = np.argsort(numbers, axis=1)
    columns = [keys[:, :first], np.take_along_axis(numbers, order, axis=1)]
    there = keys[:, first + nv :]
    for body in master.bodies:
        there = _numbers(body, there[..., None])
    for tool in master.tools if there.shape[1] else ():
        there = _numbers_of_tool(tool.as_facets(slave.axisymmetric), there)
    columns.append(np.sort(there, axis=1))
    return np.column_stack(columns), np.take_along_axis(place, order, axis=1)


def _known_by(slip: Slip) -> tuple[Indices, Array]:
    """Input numbers of the vertices of the facets on both sides, and positions. Collective.

    Vertices are in the order of their input numbers, which does not depend on the partition.
    """
    points, place = slip.gap.points, slip.gap.points.multiplier_values
    slave = _numbers(slip.gap.slave, points.slave["dofs"])
    order = np.argsort(slave, axis=1)
    columns = [carried.parts(slip), np.take_along_axis(slave, order, axis=1)]
    for body in slip.gap.master.bodies:
        columns.append(np.sort(_numbers(body, points.master["dofs"]), axis=1))
    for tool in slip.gap.master.tools if points.faced.shape[1] else ():
        there = _numbers_of_tool(tool.as_facets(slip.gap.slave.axisymmetric), points.faced)
        columns.append(np.sort(there, axis=1))
    return np.column_stack(columns), np.take_along_axis(place, order, axis=1)


def _numbers(surface: Surface, dofs: Indices) -> Indices:
    """Input numbers of vertices at points, −1 if there is none, (points, vertices). Collective."""
    vec, wanted = surface.create_vec(), dofs[:, : surface.num_facet_vertices, 0]
    unknowns, numbers = vertex_unknowns(surface.V)
    owned = unknowns < vec.local_size
    vec.array[unknowns[owned]] = numbers[owned]
    out = _gathered(vec, wanted).astype(np.int64)
    out[wanted < 0] = -1
    vec.destroy()
    return out


def _numbers_of_tool(tool: FacetSurface, dofs: Indices) -> Indices:
    """Numbers from the bits of initial coordinates, for vertices at points. Collective.

    Args:
        tool: The tool's facets.
        dofs: First unknowns of the vertices, −1 for none, (points, vertices).
    """
    vec, own = tool.create_vec(), tool.node_dofs
    x = tool.initial_vertices(np.arange(len(own)))[:, : tool.gdim]
    vec.setValues(own.ravel().astype(PETSc.IntType), (x + 0.0).ravel())  # without −0
    vec.assemble()
    out = np.zeros(dofs.shape, dtype=np.int64)
    for k in range(tool.gdim):
        bits = _gathered(vec, np.where(dofs < 0, -1, dofs + k)).view(np.int64)
        out = out * 6364136223846793005 + bits  # modulo 2⁶⁴, by Knuth's MMIX multiplier
    out[dofs < 0] = -1
    vec.destroy()
    return out


def _gathered(vec: PETSc.Vec, wanted: Indices) -> Array:
    """Values of a vector at unknowns of any rank, in the shape of these; any at −1. Collective."""
    local = PETSc.Vec().createSeq(wanted.size, comm=PETSc.COMM_SELF)
    some = np.maximum(wanted, 0).ravel().astype(PETSc.IntType)
    here = PETSc.IS().createGeneral(some, PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, here, local, None)
    scatter.scatter(vec, local)
    out = np.array(local.array_r).reshape(wanted.shape)
    for thing in (local, here, scatter):
        thing.destroy()
    return out
