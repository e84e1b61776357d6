"""Data that contact of a scalar field takes from the mechanical contact of the same bodies."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import require
from qsdolfinx.base.handles import handle_of
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.following import Cut
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.surface.affine import affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.unknowns import EDGES
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Trace = tuple[Numbers, npt.NDArray[np.int32], Array]


def check_of(of: ContactModel, slave: Surface, master: AnySurface) -> None:
    """Raise an error if a mechanical contact cannot be used for a field on these surfaces.

    Raises:
        ValueError: If its facets are others, or if it keeps no contact quadrature points.
    """
    text = "mechanics: must be a contact of displacements or velocities"
    require(not of.is_scalar, f"{text}, not of scalar fields")
    text = "mechanics: contact with itself keeps no pairing points"
    require(not of.with_itself, text)
    require(len(of.of_sides) == 1, 'mechanics: "double-pass" has two slaves; use "quasi-symmetric"')
    fits = _same_facets(of.slave, slave)  # also where a rank has none
    swapped = not fits and any(_same_facets(body, slave) for body in of.master.bodies)
    require(
        not swapped, "mechanics: exchange slave and master, so that they are those of the bodies"
    )
    require(fits, "mechanics, slave: must be on the same facets of one mesh")
    for body in of.master.bodies:
        fits = any(_same_facets(body, field) for field in master.bodies)
        require(fits, "mechanics, master: must be on the same facets of one mesh")


def shares_pairs(of: ContactModel, master: AnySurface) -> bool:
    """Whether a field with this master uses the bodies' pairs: not on the mesh of a rigid tool."""
    return len(of.master.bodies) == len(master.bodies)


def _same_facets(one: Surface, other: Surface) -> bool:
    return one.mesh is other.mesh and np.array_equal(one.facets, other.facets)


def _at_nodes(source: Surface, target: Surface, values: Array) -> Array:
    """Values at owned contact nodes, (nodes,), from values at those of another surface. Collective.

    Both surfaces are on the same facets.
    """
    there = _look_up(target, source, target.node_dofs[:, 0])
    vec = source.create_vec()
    vec.array[source.node_dofs[:, 0] - vec.owner_range[0]] = values
    return _read(vec, there)


def _look_up(source: Surface, target: Surface, wanted: Numbers) -> Numbers:
    """First unknowns of the target at nodes given by first unknowns of the source. Collective.

    Args:
        source: A surface.
        target: Another surface on the same facets.
        wanted: Global unknowns of the source; −1 stays −1.
    """
    count = min(surface.trace_dofs[0].shape[1] for surface in (source, target))
    own, other = (surface.trace_dofs[0][:, :count, 0].ravel() for surface in (source, target))
    vec = source.create_vec()
    vec.setValues(own.astype(PETSc.IntType), other.astype(np.float64))
    vec.assemble()
    out = np.full(wanted.shape, -1, dtype=np.int64)
    used = wanted >= 0
    out[used] = np.rint(_read(vec, wanted[used])).astype(np.int64)
    return out


def _read(vec: PETSc.Vec, wanted: Numbers) -> Array:
    """Read entries of a vector owned by any rank, and destroy the vector. Collective."""
    local = PETSc.Vec().createSeq(wanted.size, comm=PETSc.COMM_SELF)
    places = PETSc.IS().createGeneral(wanted.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, places, local, None)
    scatter.scatter(vec, local)
    out: Array = local.array_r.copy()
    for thing in (scatter, places, local, vec):
        thing.destroy()
    return out


class BodiesContact:
    """Pairs, pressures, distances and friction of the bodies' contact, for a field on them.

    The field uses the contact pairs of the bodies, unless their master is a rigid tool and the
    field has its own mesh of this tool. In that case, the field has its own contact detection, at
    the positions of the meshes.

    Args:
        of: The bodies' contact.
        slave: Surface of the field on the facets of the bodies' slave.
        master: Surface of the field on the facets of the bodies' master, or the rigid tool.
    """

    def __init__(self, of: ContactModel, slave: Surface, master: AnySurface) -> None:
        self.of, self._slave, self._master = of, slave, master
        #: Whether the field uses the bodies' contact pairs.
        self.shares_pairs = shares_pairs(of, master)
        self._taken: _cpp.PairingPoints | Cut | None = None
        #: The bodies' gaps at their contact quadrature points.
        self.at_points: PointRows
        if self.shares_pairs:
            pairs = (of.slave, slave), (of.master, master)
            fits = all(field.degree <= body.degree for body, field in pairs)
            require(
                fits, "mechanics: the field's degree on facets must not be above the displacement's"
            )

    @property
    def is_stale(self) -> bool:
        """Whether the bodies' contact pairs have been updated since :meth:`points`."""
        return self.shares_pairs and self._present is not self._taken

    @property
    def _present(self) -> _cpp.PairingPoints | Cut:
        """The bodies' present contact quadrature points, or their present segmentation."""
        gap = self.of.gaps[0]
        return gap.points if gap.cut is None else gap.cut

    def points(self) -> _cpp.PairingPoints:
        """The bodies' contact quadrature points with the unknowns of the field. Collective."""
        self._taken, points = self._present, self.of.gaps[0].present_points
        surfaces = self.of.slave.cpp_object, self.of.master.cpp_object
        operator = _cpp.GapOperator(*surfaces, points, jump=False, rows=2)
        self.at_points = PointRows(operator, self.of.slave)
        fields = self._slave, *self._master.bodies
        sides = zip(self.of.bodies, fields, (points.slave, points.master), strict=False)
        of_slave, of_master = (*(_trace(*side) for side in sides), _of_tool())[:2]
        return _cpp.with_traces(points, 1, *of_slave, *of_master)

    def pressure(self) -> Array:
        """Contact pressure (stress), not negative. Collective.

        It is Σ_k N_k λ_k; its sum over the contact quadrature points is the force.

        Returns:
            Values at the contact quadrature points; at the nodes of the field's slave if the field
            has its own contact detection.
        """
        gap = self.of.gaps[0]
        found = gap.multiplier(self.of.eps)[:, 0]
        if not self.shares_pairs:
            on_nodes = np.asarray(gap.rows.on_nodes(found, 0.0), dtype=np.float64)
            found = _at_nodes(self.of.slave, self._slave, on_nodes)
        elif not gap.rows.are_points:
            on_nodes = np.asarray(gap.rows.on_nodes(found, 0.0), dtype=np.float64)
            found = self.at_points.from_nodes(on_nodes)
        else:  # with finite sliding the last constraints have no point
            found = found[: self.at_points.operator.num_rows]
        return np.maximum(found, 0.0)

    def rows_at_points(self, values: Array) -> Array:
        """Values of the bodies' constraints at the vertices of points' facets, (points, vertices).

        The value is 0 where there is no constraint. Collective.
        """
        slave, gap = self.of.slave, self.of.gaps[0]
        vec = slave.create_vec()
        vec.array[slave.node_dofs[gap.operator.row_node, 0] - vec.owner_range[0]] = values
        wanted = np.asarray(gap.present_points.slave["dofs"])[:, : slave.num_facet_vertices, 0]
        out = np.zeros(wanted.shape)
        used = wanted >= 0
        out[used] = _read(vec, wanted[used])
        return out

    def distance(self) -> Array:
        """Distance (length) of the bodies at their quadrature points, 0 in contact. Collective."""
        slave, operator, placement = self.of.slave, self.at_points.operator, self.of.placement
        if self.of.follows:
            return np.maximum(np.asarray(operator.initial_gap), 0.0)
        vecs = [placement.slave.vec(), placement.master.vec()]
        depth = operator.apply(handle_of(vecs[0]), handle_of(vecs[1]))[:, 0]
        if placement.master.motion is not None:
            vecs.append(affine_vec(slave, placement.master.motion))
            depth = depth - operator.apply(handle_of(vecs[-1]), 0)[:, 0]
        for vec in vecs:
            if vec is not None:
                vec.destroy()
        return np.maximum(np.asarray(operator.initial_gap) - depth, 0.0)

    def dissipation(self) -> Array:
        """Energy dissipated by friction in the last step, at the field's nodes. Collective."""
        slave, found = self.of.slave, np.zeros(len(self.of.slave.node_area))
        for slip in self.of.slips:
            own = slip.slave is slave
            found += slip.dissipation_at_nodes() if own else _faced_energy(slip, slave)
        return _at_nodes(slave, self._slave, found)


def _faced_energy(slip: Slip, slave: Surface) -> Array:
    """Move energy of friction from the master's vertices to opposite slave nodes. Collective."""
    energy = slip.dissipation()
    rows = np.zeros((len(energy), slave.gdim))
    rows[:, 0] = energy
    vecs = slip.slave.create_vec(), slave.create_vec()
    slip.operator.add_transpose(rows, *(vec.handle for vec in vecs))
    # With degree 2, nodes on edges have a part of the energy; it is moved to the vertices.
    out = -vecs[1].array_r[slave.node_dofs[:, 0] - vecs[1].owner_range[0]]
    for vec in vecs:
        vec.destroy()
    sums = slave.comm.allreduce(np.array([energy.sum(), out.sum()]), op=MPI.SUM)
    return np.asarray(out * (sums[0] / sums[1] if sums[1] > 0 else 0.0))


def _of_tool() -> Trace:
    """As :func:`_trace`, of a rigid tool: nothing."""
    return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32), np.zeros(0)


def _trace(body: Surface, field: Surface, found: dict[str, typing.Any]) -> Trace:
    """Unknowns, owners and shape functions of a field at its body's contact points. Collective.

    Args:
        body: The body's surface.
        field: The field's surface.
        found: One side of the contact quadrature points.
    """
    dofs, values = np.asarray(found["dofs"])[..., 0], np.asarray(found["shape_values"])
    if field.degree < body.degree:
        values = values @ _lowering(field.num_facet_vertices)
        dofs = dofs[:, : field.num_facet_vertices]
    unknowns = _look_up(body, field, dofs)
    return unknowns, _owners(field, unknowns), np.ascontiguousarray(values)


def _lowering(num_vertices: int) -> Array:
    """Functions of degree 1 in the basis of degree 2: their values at nodes, (nodes, vertices)."""
    rows: list[Array] = list(np.eye(num_vertices))
    rows += [(rows[a] + rows[b]) / 2 for a, b in EDGES[num_vertices]]
    if num_vertices == 4:
        rows.append(np.full(4, 0.25))
    return np.array(rows)


def _owners(surface: Surface, unknowns: Numbers) -> npt.NDArray[np.int32]:
    """Ranks that own unknowns of a surface's body; −1 where there is no unknown. Collective."""
    vec = surface.create_vec()
    ends = np.asarray(vec.owner_ranges)[1:]
    vec.destroy()
    owners = np.searchsorted(ends, unknowns, side="right").astype(np.int32)
    return np.where(unknowns >= 0, owners, np.int32(-1))
