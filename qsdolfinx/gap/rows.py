"""What the rows of a gap are: slave nodes, or the pairing points themselves."""

from __future__ import annotations

import abc

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]

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
        """Values of the owned nodes at the rows."""


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
    """One row for each pairing point, on the rank that found it."""

    are_points = True

    def __init__(self, operator: _cpp.GapOperator, slave: Surface) -> None:
        super().__init__(operator, slave)
        #: Σ_p w_p N_k(ξ_p) at the owned nodes: what the points cover of S_k.
        self.cover: Array = self.sums(np.ones(operator.num_rows))

    @property
    def reached(self) -> npt.NDArray[np.int64]:
        """Nodes that points cover some of. Not collective."""
        return np.flatnonzero(self.cover > _SOME * self.slave.node_area)

    def sums(self, values: Array) -> Array:
        """Σ_p w_p N_k(ξ_p) c_p at the owned nodes."""
        vec = self.slave.create_vec()
        self.operator.add_to_nodes(self.operator.row_area * values, vec.handle)
        return self._read(vec)

    def on_nodes(self, values: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Means Σ_p w_p N_k c_p / Σ_p w_p N_k; of flags whether there is any."""
        flags = values.dtype == bool
        columns = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
        sums = np.column_stack([self.sums(c) for c in columns.T.astype(np.float64)])
        out = np.full(sums.shape, missing, dtype=np.float64)
        at = self.reached
        out[at] = sums[at] / self.cover[at, None]
        if flags:
            out = out > _SOME
        return np.asarray(out.reshape(len(out), *values.shape[1:]))

    def project(self, values: Array) -> Array:
        """Nodal values of nearly the function Σ_k N_k v_k that is closest to values of the points.

        The mass matrix M_kl = Σ_p w_p N_k N_l of what is covered is inverted by some iterations of
        Richardson's with the lumped one: M may be singular in all but name where hardly anything
        of a facet is covered, and they leave out of v what it says nothing of.
        """
        columns = values.T
        out = np.zeros((len(self.cover), len(columns)))
        at = self.reached
        for x, column in zip(out.T, columns, strict=True):
            for i in range(_RICHARDSON):
                rest = self.sums(column - self._at_points(x) if i else column)
                x[at] += rest[at] / self.cover[at]
        return out

    def largest_on_nodes(self, values: Array) -> Array:
        """The largest value of the points beside each node."""
        vec = self.slave.create_vec()
        self.operator.raise_nodes(np.ascontiguousarray(values), vec.handle)
        return self._read(vec)

    def from_nodes(self, values: Array) -> Array:
        """Values of the function Σ_k N_k v_k."""
        columns = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
        out = np.column_stack([self._at_points(c) for c in columns.T])
        return np.asarray(out.reshape(len(out), *values.shape[1:]))

    def _at_points(self, values: Array) -> Array:
        vec = self.slave.create_vec()
        vec.array[self._own(vec)] = values
        out = self.operator.at_points(vec.handle)
        vec.destroy()
        return np.asarray(out)

    def _read(self, vec: PETSc.Vec) -> Array:
        """First components at the owned nodes of a vector, which is destroyed."""
        out: Array = vec.array_r[self._own(vec)].copy()
        vec.destroy()
        return out

    def _own(self, vec: PETSc.Vec) -> npt.NDArray[np.int64]:
        return np.asarray(self.slave.node_dofs[:, 0] - vec.owner_range[0])
