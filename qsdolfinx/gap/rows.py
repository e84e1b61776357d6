"""What the rows of a gap are: slave nodes, or the pairing points themselves."""

from __future__ import annotations

import abc

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.extension import Extension
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Where the law of contact is asked: for the weighted gaps of nodes, or for the gaps of points.
CONSTRAINTS = ("nodes", "points")

#: Part of a node's area that may be rounding.
_SOME = 1e-10

#: Iterations for a mass matrix. Its least eigenvalue over the lumped one is 1/3 in 2D, 1/4 on
#: triangles.
_RICHARDSON = 8


class Rows(abc.ABC):
    """Rows of a gap operator, and how values go between them and the slave's nodes.

    All methods are collective, unless a subclass says otherwise.

    Args:
        operator: The gap operator.
        slave: Surface that carries the multiplier.
    """

    #: Whether rows are points.
    are_points: bool

    def __init__(self, operator: _cpp.GapOperator, slave: Surface) -> None:
        self.operator, self.slave = operator, slave

    @property
    @abc.abstractmethod
    def reached(self) -> npt.NDArray[np.int64]:
        """Owned nodes of the slave that a pairing point reaches, ascending."""

    @abc.abstractmethod
    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Values of the rows at all owned nodes: means over what a node covers."""

    @abc.abstractmethod
    def largest_on_nodes(self, values: Array) -> Array:
        """The largest of the values at a node's rows, at least 0; for values of shape (rows,)."""

    @abc.abstractmethod
    def from_nodes(self, values: Array) -> Array:
        """Values of the owned nodes at the rows; at points of shape (nodes,)."""


class NodeRows(Rows):
    """One row for each slave node that a pairing point reaches; nothing here is collective."""

    are_points = False

    @property
    def reached(self) -> npt.NDArray[np.int64]:
        """Nodes of the rows."""
        return self.operator.row_node

    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """The values themselves."""
        out = np.full((len(self.slave.node_area), *values.shape[1:]), missing, dtype=values.dtype)
        out[self.operator.row_node] = values
        return out

    def largest_on_nodes(self, values: Array) -> Array:
        """The values themselves."""
        return np.asarray(np.maximum(self.on_nodes(values, 0.0), 0.0), dtype=np.float64)

    def from_nodes(self, values: Array) -> Array:
        """The values themselves."""
        return np.array(values[self.operator.row_node], dtype=np.float64)


class PointRows(Rows):
    """One row for each pairing point, on the rank that found it.

    A field on the nodes may have a value for each smooth side of the surface at a node, in columns
    that are counted by the number of the side: more than one where the surface turns sharply.
    """

    are_points = True

    def __init__(self, operator: _cpp.GapOperator, slave: Surface) -> None:
        super().__init__(operator, slave)
        #: Σ_p w_p N_k(ξ_p) of the sides of the owned nodes, shape (nodes, gdim).
        self.cover_of_sides: Array = self._sums(np.ones(operator.num_rows))
        #: The same of nodes: what the points cover of S_k.
        self.cover: Array = self.cover_of_sides.sum(axis=1)
        #: Sides of nodes that points cover some of, of that shape.
        self.covered: Flags = self.cover_of_sides > _SOME * slave.node_area[:, None]

    @property
    def reached(self) -> npt.NDArray[np.int64]:
        """Nodes that points cover some of. Not collective."""
        return np.flatnonzero(self.cover > _SOME * self.slave.node_area)

    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Means Σ_p w_p N_k c_p / Σ_p w_p N_k; of flags whether there is any."""
        flags = values.dtype == bool
        columns = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
        sums = [self._sums(c).sum(axis=1) for c in columns.T.astype(np.float64)]
        means = np.full((len(self.cover), len(sums)), missing, dtype=np.float64)
        at = self.reached
        means[at] = np.column_stack(sums)[at] / self.cover[at, None]
        out = means > _SOME if flags else means
        return np.asarray(out.reshape(len(out), *values.shape[1:]))

    def largest_on_nodes(self, values: Array) -> Array:
        """The largest value of the points beside each node."""
        vec = self.slave.create_vec()
        self.operator.raise_nodes(np.ascontiguousarray(values), vec.handle)
        return np.asarray(self._read(vec).max(axis=1))

    def from_nodes(self, values: Array) -> Array:
        """Values of the function Σ_k N_k v_k."""
        return self.from_sides(np.repeat(values[:, None], self.slave.gdim, axis=1))

    def from_sides(self, values: Array) -> Array:
        """Values of the function Σ_k N_k v_k that each point sees on its side, shape (rows,)."""
        vec = self.slave.create_vec()
        vec.array[self._own(vec)] = values
        out = self.operator.at_points(vec.handle)
        vec.destroy()
        return np.asarray(out)

    def project(self, values: Array, extension: Extension | None) -> Array:
        """Nearly the function Σ_k N_k v_k that is closest to values of the points, of all sides.

        The mass matrix M_kl = Σ_p w_p N_k N_l of what is covered is inverted by some iterations of
        Richardson's with the lumped one: M may be singular in all but name where hardly anything
        of a facet is covered, and they leave out of v what it says nothing of.

        Args:
            values: Of the points, shape (rows,).
            extension: Which v_k follow from others, v = E v_free; the matrix is Eᵀ M E then.
        """
        cover, at = self.cover_of_sides, self.covered
        if extension is not None:
            cover, at = extension.gather(cover), at & ~extension.held
        free, out, rest = np.zeros_like(cover), np.zeros_like(cover), values
        for _ in range(_RICHARDSON):
            sums = self._sums(rest)
            if extension is not None:
                sums = extension.gather(sums)
            free[at] += sums[at] / cover[at]
            out = free.copy() if extension is None else extension.fill(free)
            rest = values - self.from_sides(out)
        return out

    def _sums(self, values: Array) -> Array:
        """Σ_p w_p N_k(ξ_p) c_p for the sides of the owned nodes."""
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
