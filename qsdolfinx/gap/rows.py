"""Constraints of a gap operator: one per slave node, or one per contact quadrature point."""

from __future__ import annotations

import abc
import contextlib
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.gap.extension import Extension
from qsdolfinx.pairing.pair import LEAST_COVER
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Where the contact law is evaluated: for the weighted gaps of nodes, or for the gaps of points.
CONSTRAINTS = ("nodes", "points")


class Rows(abc.ABC):
    """Constraints of a gap operator, and transfer of values between them and the slave's nodes.

    "Rows" in names and shapes are the constraints.

    All methods are collective, unless a subclass says otherwise.

    Args:
        operator: The gap operator.
        slave: Surface that carries the multiplier.
    """

    #: Whether constraints are at contact quadrature points.
    are_points: bool

    def __init__(self, operator: _cpp.GapOperator, slave: Surface) -> None:
        self.operator, self.slave = operator, slave
        self._kept_area: Array | None = None

    @property
    def node_area(self) -> Array:
        """S_k of the owned nodes of the slave, shape (nodes,). Not collective."""
        return self.slave.node_area if self._kept_area is None else self._kept_area

    def keep_areas(self) -> None:
        """Keep the present :attr:`node_area` when the slave moves."""
        self._kept_area = self.node_area

    @property
    @abc.abstractmethod
    def reached(self) -> npt.NDArray[np.int64]:
        """Owned nodes of the slave in whose support there is a quadrature point, ascending."""

    @abc.abstractmethod
    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Values of the constraints at all owned nodes: means over the support of a node."""

    @abc.abstractmethod
    def largest_on_nodes(self, values: Array) -> Array:
        """The largest value of a node's constraints, at least 0; for values of shape (rows,)."""

    @abc.abstractmethod
    def sums_on_nodes(self, values: Array) -> Array:
        """Distribute values of shape (rows,) to all owned nodes, by their parts of a constraint."""

    @abc.abstractmethod
    def from_nodes(self, values: Array) -> Array:
        """Values of the owned nodes at the constraints; with points for shape (nodes,) only."""

    def from_largest(self, values: Array) -> Array:
        """Result of :meth:`largest_on_nodes`, perhaps of other constraints, at the constraints."""
        return self.from_nodes(values)

    # --- History variables: functions with a value for each patch of a node, (nodes, patches)

    @property
    @abc.abstractmethod
    def num_patches(self) -> int:
        """Number of values of a node, see :class:`LawMemory`. Not collective."""

    @abc.abstractmethod
    def from_patches(self, values: Array) -> Array:
        """Values of a function of the patches of owned nodes at the constraints, (rows,)."""

    @abc.abstractmethod
    def advanced(self, before: Array, old: Array, new: Array) -> Array:
        """Function of the patches after its values at the constraints have changed.

        Args:
            before: The function, (nodes, patches).
            old: Its values at the constraints, (rows,).
            new: The values that they have changed to, (rows,).
        """

    @abc.abstractmethod
    def means_of_patches(self, values: Array) -> Array:
        """Mean over the patches of each owned node, (nodes,)."""

    @abc.abstractmethod
    def areas(self, now: Array, paired: Array) -> Array:
        """Area of the slave of each constraint, shape (rows,).

        Args:
            now: Areas of the owned nodes in the wanted configuration, shape (nodes,).
            paired: Areas of the owned nodes at contact detection, shape (nodes,).
        """


class NodeRows(Rows):
    """One constraint for each slave node with a quadrature point in its support; not collective.

    A node in the corner of several walls has a constraint for each of its smooth patches that faces
    a wall. Values that have to survive an update of the contact pairs are then stored per patch,
    see :meth:`on_sides`.

    Args:
        operator: The gap operator.
        slave: Surface that carries the multiplier.
        by_sides: Whether there may be nodes in corners, on any rank.
    """

    are_points = False

    def __init__(self, operator: _cpp.GapOperator, slave: Surface, by_sides: bool) -> None:
        super().__init__(operator, slave)
        self._node = operator.row_node
        #: Whether the node of a constraint is in a corner; false for all without ``by_sides``.
        self.in_corner: npt.NDArray[np.bool_] = np.zeros(len(self._node), dtype=bool)
        self._by_sides = by_sides
        self._side: npt.NDArray[np.int64] = np.zeros(len(self._node), dtype=np.int64)
        if by_sides and len(self._node) > 0:
            self.in_corner = operator.row_in_corner.astype(bool)
            self._side = operator.row_side.astype(np.int64)

    @property
    def reached(self) -> npt.NDArray[np.int64]:
        """Nodes of the constraints."""
        return np.unique(self._node) if self.in_corner.any() else self._node

    def areas(self, now: Array, paired: Array) -> Array:
        """Areas of the nodes; in corners the part of the constraint's patch."""
        of_nodes = now[self._node]
        if not self.in_corner.any():
            return np.asarray(of_nodes)
        share = self.operator.row_area / paired[self._node]
        return np.where(self.in_corner, share * of_nodes, of_nodes)

    def dofs(self, width: int) -> tuple[list[slice], list[npt.NDArray[np.int64]]]:
        """Unknowns of the slave that store values of constraints in its vectors. Collective.

        These are the first unknowns of a node. If there may be corners, only one column of the
        values can be stored at a time: each patch of a node has one unknown, and a node that is in
        no corner uses that of its first patch.

        Returns:
            Columns that are stored at a time; and the global unknowns of the constraints, shape
            (rows, n), and of the constraints at the vertices of facets, shape (facets, vertices,
            n).
        """
        of_nodes = self.slave.node_dofs
        of_facets = self.slave.cpp_object.facet_dofs[:, : self.slave.num_facet_vertices]
        if not self._by_sides:
            return [slice(0, width)], [of_nodes[self._node, :width], of_facets[:, :, :width]]
        chosen = np.zeros(len(of_nodes), dtype=np.uint8)
        chosen[self._node[self.in_corner]] = 1
        sides = self.slave.cpp_object.sides_of_facets(chosen)[:, :, None].astype(np.int64)
        own = np.where(self.in_corner, self._side, 0)
        places = [of_nodes[self._node, own][:, None], np.take_along_axis(of_facets, sides, axis=2)]
        return [slice(i, i + 1) for i in range(width)], places

    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """The values themselves; in corners area-weighted means, for flags whether any is set."""
        out = np.full((len(self.slave.node_area), *values.shape[1:]), missing, dtype=values.dtype)
        out[self._node] = values
        if not self.in_corner.any():
            return out
        at, several = self._node[self.in_corner], values[self.in_corner]
        if values.dtype == bool:
            out[at] = False
            np.logical_or.at(out, at, several)
            return out
        area = self.operator.row_area[self.in_corner]
        whole = np.zeros(len(out))
        np.add.at(whole, at, area)
        out[at] = 0
        np.add.at(out, at, (several.astype(np.float64).T * (area / whole[at])).T)
        return out

    def sums_on_nodes(self, values: Array) -> Array:
        """Values of shape (rows,) at all owned nodes, summed in corners; 0 without a constraint."""
        out = np.zeros(len(self.slave.node_area))
        np.add.at(out, self._node, values)
        return out

    def largest_on_nodes(self, values: Array) -> Array:
        """The values themselves, or values per smooth patch."""
        found = self.on_sides(values[:, None]) if self._by_sides else self.on_nodes(values, 0.0)
        return np.asarray(np.maximum(found, 0.0), dtype=np.float64)

    def from_nodes(self, values: Array) -> Array:
        """The values themselves."""
        return np.array(values[self._node], dtype=np.float64)

    def from_largest(self, values: Array) -> Array:
        """The values themselves, or values per smooth patch."""
        return self.from_sides(values)[:, 0] if self._by_sides else self.from_nodes(values)

    def on_sides(self, values: Array) -> Array:
        """Values of shape (rows, width) at all owned nodes, 0 where there is no constraint.

        Returns:
            Values of shape (nodes, width). If there may be nodes in corners, shape (nodes, gdim ·
            width) with one block per smooth patch; blocks of patches without a constraint are 0.
        """
        if not self._by_sides:
            return np.asarray(self.on_nodes(values, 0.0), dtype=np.float64)
        num_nodes, width = len(self.slave.node_area), values.shape[1]
        out = np.zeros((num_nodes, self.slave.gdim, width))
        out[self._node, self._side] = values
        return out.reshape(num_nodes, self.slave.gdim * width)

    def from_sides(self, values: Array) -> Array:
        """Values of :meth:`on_sides` at the constraints, shape (rows, width).

        A node that is in no corner and now faces the master with another smooth patch keeps its
        value.
        """
        if not self._by_sides:
            return self.from_nodes(values)
        width = values.shape[1] // self.slave.gdim
        at_rows = self.from_nodes(values).reshape(len(self._node), self.slave.gdim, width)
        own = at_rows[np.arange(len(at_rows)), self._side]
        turned = ~self.in_corner & ~np.any(own, axis=1)
        return np.where(turned[:, None], at_rows.sum(axis=1), own)

    @property
    def num_patches(self) -> int:
        """One, for the node."""
        return 1

    def from_patches(self, values: Array) -> Array:
        """The values themselves."""
        return self.from_nodes(values[:, 0])

    def advanced(self, before: Array, old: Array, new: Array) -> Array:
        """The new values; in corners the mean change."""
        return np.asarray(before + self.on_nodes(new - old, 0.0).astype(np.float64)[:, None])

    def means_of_patches(self, values: Array) -> Array:
        """The values themselves."""
        return np.array(values[:, 0])


class PointRows(Rows):
    """One constraint for each contact quadrature point, on the rank that found the point.

    A field on the nodes may have a value for each smooth patch of the surface at a node; the column
    is the number of the patch. At sharp edges a node has more than one patch.

    Args:
        operator: The gap operator at the points.
        slave: Surface that carries the multiplier.
        are_own: Whether points are vertices, each with its own multiplier. These multipliers are
            not a field, and none of them is determined by its neighbours.
        num_alone: Number of points without a partner, which are the last ones.
    """

    are_points = True

    def __init__(
        self,
        operator: _cpp.GapOperator,
        slave: Surface,
        are_own: bool = False,
        num_alone: int = 0,
    ) -> None:
        super().__init__(operator, slave)
        self._are_own, self._num_alone = are_own, num_alone
        #: Σ_p w_p N_k(ξ_p) of the smooth patches of the owned nodes, shape (nodes, block).
        self.cover_of_sides: Array = self._sums(np.ones(operator.num_rows))
        #: The same for nodes: the covered part of S_k.
        self.cover: Array = self.cover_of_sides.sum(axis=1)
        #: Whether a patch of a node is covered at least in part, shape (nodes, block).
        self.covered: Flags = self.cover_of_sides > ROUNDING * slave.node_area[:, None]

    def areas(self, now: Array, paired: Array) -> Array:
        """Weights of the points, with the parts N_k scaled by the change of area of node k."""
        return np.asarray(self.operator.row_area * self.from_nodes(now / paired))

    @property
    def reached(self) -> npt.NDArray[np.int64]:
        """Nodes that are covered at least in part. Not collective."""
        return np.flatnonzero(self.cover > ROUNDING * self.slave.node_area)

    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Means Σ_p w_p N_k c_p / Σ_p w_p N_k; for flags whether any is set."""
        flags = values.dtype == bool
        columns = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
        sums = [self._sums(c).sum(axis=1) for c in columns.T.astype(np.float64)]
        means = np.full((len(self.cover), len(sums)), missing, dtype=np.float64)
        at = self.reached
        means[at] = np.column_stack(sums)[at] / self.cover[at, None]
        out = means > ROUNDING if flags else means
        return np.asarray(out.reshape(len(out), *values.shape[1:]))

    def largest_on_nodes(self, values: Array) -> Array:
        """The largest value of the points beside each node."""
        return np.maximum(self.largest_of_sides(values).max(axis=1), 0.0)

    def from_nodes(self, values: Array) -> Array:
        """Values of the function Σ_k N_k v_k."""
        return self.from_sides(np.repeat(values[:, None], self.slave.block, axis=1))

    def from_sides(self, values: Array) -> Array:
        """Values of Σ_k N_k v_k at the points, with v_k of their smooth patch, shape (rows,)."""
        vec = self.slave.create_vec()
        vec.array[self._own(vec)] = values
        out = self.operator.at_points(vec.handle)
        vec.destroy()
        return np.asarray(out)

    def sums(self, values: Array) -> Array:
        """Σ_p w_p N_k(ξ_p) c_p of values of shape (rows,), for the patches of the owned nodes."""
        return self._sums(values)

    def sums_on_nodes(self, values: Array) -> Array:
        """Σ_p N_k(ξ_p) c_p of values of shape (rows,) at all owned nodes."""
        area = self.operator.row_area
        of_area = np.divide(values, area, out=np.zeros_like(area), where=area > 0)
        return np.asarray(self._sums(of_area).sum(axis=1))

    def means_of_some(self, values: Array, which: Flags) -> Array:
        """Means of vectors over selected points; over all points at nodes without selected points.

        Args:
            values: Vectors at the points, shape (rows, gdim).
            which: The selected points.
        """
        some = np.column_stack([np.where(which[:, None], values, 0.0), values, which])
        means, gdim = self.on_nodes(some, 0.0).astype(np.float64), values.shape[1]
        part = means[:, -1:]
        return np.where(
            part > ROUNDING, means[:, :gdim] / np.maximum(part, ROUNDING), means[:, gdim:-1]
        )

    # --- Vectors of the patches of a node in one row, (nodes, block · gdim)

    def vectors_from_sides(self, values: Array) -> Array:
        """Values of the vector function Σ_k N_k v_k at the points, shape (rows, gdim)."""
        columns = range(values.shape[1] // self.slave.block)
        sides = values.reshape(len(values), self.slave.block, len(columns))
        return np.column_stack([self.from_sides(sides[:, :, k]) for k in columns])

    def sums_of_vectors(self, values: Array) -> Array:
        """Σ_p w_p N_k(ξ_p) v_p of values of shape (rows, gdim), for the patches of owned nodes."""
        sums = np.stack([self._sums(np.ascontiguousarray(v)) for v in values.T], axis=2)
        return np.asarray(sums.reshape(len(sums), self.slave.block * values.shape[1]))

    def projected(self, values: Array) -> Array:
        """Project values at points onto functions of the nodes, Σ w_p |v_h − v_p|² → min.

        The forces on the slave's nodes do not change. Values of patches that are hardly covered
        follow from the neighbouring patches.

        Args:
            values: Vectors at the points, shape (rows, gdim).
        """
        extension = self.extended(None)
        free = self.covered if extension is None else self.covered & ~extension.held
        cover = np.where(free, self.cover_of_sides, 1.0)

        def full(values: Array) -> Array:
            out = np.where(free, values, 0.0)
            return out if extension is None else extension.fill(out)

        def gathered(values: Array) -> Array:
            sums = self._sums(values)
            sums = sums if extension is None else extension.gather(sums)
            return np.where(free, sums, 0.0)

        def dot(a: Array, b: Array) -> float:
            return float(self.slave.comm.allreduce(float(np.sum(a * b)), op=MPI.SUM))

        # To rounding by conjugate gradients: where nodes are covered, the mass matrix over its
        # diagonal is as well conditioned as that of one facet.
        found = []
        for column in values.T:
            x = np.zeros(free.shape)
            r = gathered(np.ascontiguousarray(column))
            z = r / cover
            p, rz = z, dot(r, z)
            last = 1e-12**2 * rz
            for _ in range(200):
                if rz <= last:
                    break
                q = gathered(self.from_sides(full(p)))
                step = rz / dot(p, q)
                x, r = x + step * p, r - step * q
                z = r / cover
                rz, before = dot(r, z), rz
                p = z + rz / before * p
            found.append(full(x))
        return np.stack(found, axis=2).reshape(len(cover), self.slave.block * len(found))

    # --- History variables

    @property
    def num_patches(self) -> int:
        """Largest number of smooth patches of a node."""
        return self.slave.block

    def from_patches(self, values: Array) -> Array:
        """Values of Σ_k N_k v_k at the points."""
        return self.from_sides(values)

    def advanced(self, before: Array, old: Array, new: Array) -> Array:
        """The function with the projected change.

        Columns without a patch get the mean change of the patches of their node, so that transfer
        to another mesh, whose nodes have other patches, finds a value there.
        """
        change = self.projected((new - old)[:, None])
        mean = self.means_of_patches(change)[:, None]
        return np.asarray(before + np.where(self.area_of_sides > 0, change, mean))

    def means_of_patches(self, values: Array) -> Array:
        """Means with the areas of the patches."""
        area = self.area_of_sides
        whole = area.sum(axis=1)
        sums = np.sum(area * values, axis=1)
        return np.divide(sums, whole, out=values.mean(axis=1), where=whole > 0)

    def extended(self, held: Extension | None) -> Extension | None:
        """Extension of redundant multipliers and of hardly covered multipliers. Collective.

        A hardly covered multiplier is included if a neighbour is covered by more.

        Args:
            held: Extension of the multipliers that Dirichlet conditions on both sides make
                redundant; None for none.
        """
        hardly = (
            self.covered & (self.paired < LEAST_COVER * self.area_of_sides) & (not self._are_own)
        )
        found = self.extension(hardly, hardly, held)
        if found is None or found is held:
            return held
        hardly = hardly & found.filled
        return self.extension(hardly, hardly, held)

    @functools.cached_property
    def paired(self) -> Array:
        """Area of each patch that points with a partner cover, (nodes, block)."""
        each = np.ones(self.operator.num_rows)
        each[len(each) - self._num_alone :] = 0.0
        return self._sums(each)

    def least_cover(self, extended: Extension | None) -> Array:
        """Covered areas of patches below which points without a partner have the rest. Collective.

        Of condensed multipliers this is hardly anything: it would reduce those of the neighbours,
        by 1.5 % of displacements in ``tests/sliding/test_small_limit.py``, "swapped". Multipliers
        that are hardly covered now, but not condensed, keep half of what is covered.

        Args:
            extended: Extension of condensed multipliers; None for none.

        Returns:
            The areas, (nodes, block).
        """
        area, paired = self.area_of_sides, self.paired
        least = LEAST_COVER * area
        hardly = (paired > 0) & (paired < least) & (not self._are_own)
        out = np.where(hardly, paired / 2, least)
        return out if extended is None else np.where(extended.filled, 1e-8 * area, out)

    def largest_of_sides(self, values: Array) -> Array:
        """The largest value of the points in the support of each patch of an owned node, or −∞."""
        vec = self.slave.create_vec()
        vec.set(-np.inf)
        self.operator.raise_nodes(np.ascontiguousarray(values), vec.handle)
        return self._read(vec)

    def least_from_sides(self, values: Array) -> Array:
        """The least value of the patches in whose support a point is, or ∞, shape (rows,)."""
        offset, found = self.operator.functions[0], self._at_functions(values)
        some, out = np.diff(offset) > 0, np.full(len(offset) - 1, np.inf)
        if some.any():
            out[some] = np.minimum.reduceat(found, offset[:-1][some])
        return out

    def _at_functions(self, values: Array) -> Array:
        """Values of the patches of owned nodes, for each entry of ``operator.functions``."""
        with self._scattered() as (vec, local, scatter):
            vec.array[self._own(vec)] = values
            scatter.scatter(vec, local)
            out: Array = local.array_r.copy()
        return out

    @contextlib.contextmanager
    def _scattered(self) -> typing.Iterator[tuple[PETSc.Vec, PETSc.Vec, PETSc.Scatter]]:
        """A vector of the slave, one of the functions of all points, and a scatter between them."""
        unknowns = self.operator.functions[1]
        vec, local = self.slave.create_vec(), PETSc.Vec().createSeq(len(unknowns))
        here = PETSc.IS().createGeneral(unknowns.astype(PETSc.IntType), PETSc.COMM_SELF)
        scatter = PETSc.Scatter().create(vec, here, local, None)
        try:
            yield vec, local, scatter
        finally:
            for thing in (vec, local, here, scatter):
                thing.destroy()

    @functools.cached_property
    def area_of_sides(self) -> Array:
        """∫ N_k of the patches of the owned nodes, of rings if axisymmetric, (nodes, block)."""
        slave = self.slave
        corners = slave.coordinates[0][:, : slave.num_facet_vertices]
        if slave.num_facet_vertices == 2:
            area = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        else:  # for quadrilaterals, with vertices in tensor order, both halves
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            area = np.linalg.norm(normals, axis=1) * (slave.num_facet_vertices - 2) / 2
        if slave.axisymmetric:
            area = area * 2 * np.pi * corners[:, :, 0].mean(axis=1)
        shares = np.repeat(area / slave.num_facet_vertices, slave.num_facet_vertices)
        vec = slave.create_vec()
        vec.setValues(
            self._corners.ravel().astype(PETSc.IntType), shares, PETSc.InsertMode.ADD_VALUES
        )
        vec.assemble()
        return self._read(vec)

    @property
    def _corners(self) -> npt.NDArray[np.int64]:
        """Unknowns that represent the patches of the facets' vertices, shape (facets, vertices)."""
        slave = self.slave
        sides = slave.cpp_object.vertex_side[:, :, None].astype(np.int64)
        of_facets = slave.cpp_object.facet_dofs[:, : slave.num_facet_vertices]
        return np.asarray(np.take_along_axis(of_facets, sides, axis=2)[:, :, 0])

    def extension(
        self,
        held: Flags,
        clamped: Flags,
        known: Extension | None = None,
        everywhere: bool = False,
    ) -> Extension | None:
        """Extension of multipliers of patches that are no unknowns; None without any.

        Args:
            held: Patches whose multipliers are no unknowns, shape (nodes, block).
            clamped: The patches among these whose multiplier is the mean of its neighbours.
            known: Another extension, to which this one is added.
            everywhere: Whether patches count that are not covered at present.
        """
        if not self.slave.comm.allreduce(bool(held.any()), op=MPI.LOR):
            return known
        if known is not None:
            held, clamped = held | known.held, clamped | known.clamped
        there = self.covered | everywhere
        places, every = (
            [self.slave.node_dofs, self._corners[:, :, None]],
            slice(0, self.slave.block),
        )
        return Extension(self.slave, [every], places, held & there, clamped & there, ~there)

    def _sums(self, values: Array) -> Array:
        """Σ_p w_p N_k(ξ_p) c_p for the patches of the owned nodes."""
        vec = self.slave.create_vec()
        self.operator.add_to_nodes(self.operator.row_area * values, vec.handle)
        return self._read(vec)

    def _read(self, vec: PETSc.Vec) -> Array:
        """Values at the owned nodes of a vector, which is destroyed."""
        out: Array = vec.array_r[self._own(vec)].copy()
        vec.destroy()
        return out

    def _own(self, vec: PETSc.Vec) -> npt.NDArray[np.int64]:
        return np.asarray(self.slave.node_dofs - vec.owner_range[0])
