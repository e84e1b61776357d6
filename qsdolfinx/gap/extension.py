"""Condense multipliers that Dirichlet conditions on both sides make redundant."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class Sweep(typing.NamedTuple):
    """One sweep of averaging: multipliers computed as means of known neighbours.

    Attributes:
        new: Multipliers computed in this sweep, of the shape of the multipliers.
        known: Multipliers known before, of the shape of the multipliers.
        part: 1 / number of known neighbours, for multipliers computed in this sweep.
    """

    new: Flags
    known: Flags
    part: Array


class Extension:
    """Redundant multipliers of one integration side, and their values: λ = E λ_free.

    Where Dirichlet conditions act on both bodies along the surface only, as on a plane of symmetry,
    the component of the multiplier is zero: beyond the plane it has the opposite sign. Where both
    bodies are clamped, the multiplier is the mean of its neighbours, so that a uniform multiplier
    stays uniform.

    Collective.

    Args:
        slave: Surface that carries the multiplier.
        columns: Columns of the multipliers that are stored in a vector of the slave's body one
            after the other.
        places: Numbers of the multipliers among the unknowns of this body, shape (rows, n), and at
            the vertices of the facets, shape (facets, vertices, n). Means are over multipliers with
            the same index in the last axis.
        held: Redundant multipliers, with Dirichlet conditions on both sides, shape (rows, width).
        clamped: Redundant multipliers at nodes that are clamped in all directions, of the same
            shape.
        missing: Multipliers that do not exist, of the same shape.
    """

    def __init__(
        self,
        slave: Surface,
        columns: typing.Sequence[slice],
        places: typing.Sequence[npt.NDArray[np.int64]],
        held: Flags,
        clamped: Flags,
        missing: Flags | None = None,
    ) -> None:
        #: Redundant multipliers, which are no unknowns, shape (rows, width).
        self.held = held
        #: Redundant multipliers that are the mean of their neighbours, of the same shape.
        self.clamped = clamped
        self._slave, self._columns = slave, columns
        self._at, corners = places
        self._shape, self._corners = corners.shape, np.ascontiguousarray(corners).ravel()
        known = ~held if missing is None else ~held & ~missing
        self._sweeps: list[Sweep] = []
        # In a corner, all nodes of a triangle can be constrained, which is two facets wide.
        for _ in range(2):
            counts = self._around(known.astype(np.float64))
            new = clamped & ~known & (counts > 0.5)
            self._sweeps.append(Sweep(new, known, np.where(new, 1 / np.maximum(counts, 1), 0.0)))
            known = known | new

    @property
    def filled(self) -> Flags:
        """Multipliers that are computed from their neighbours, shape (rows, width)."""
        return np.asarray(np.any([sweep.new for sweep in self._sweeps], axis=0))

    def fill(self, values: Array, closed: Flags | None = None) -> Array:
        """E λ_free: all multipliers, with the redundant ones filled in, (rows, width). Collective.

        Args:
            values: The multipliers.
            closed: Active constraints, if multipliers belong to constraints: redundant multipliers
                of inactive constraints are 0.
        """
        out = np.where(self.held, 0.0, values)
        for sweep in self._sweeps:
            sums = self._around(np.where(sweep.known, out, 0.0))
            out = np.where(sweep.new, sums * sweep.part, out)
        return out if closed is None else np.where(self.held & ~closed[:, None], 0.0, out)

    def gather(self, values: Array) -> Array:
        """Eᵀ times values of the multipliers; 0 at redundant multipliers. Collective."""
        out = values
        for sweep in reversed(self._sweeps):
            back = self._around(np.where(sweep.new, out * sweep.part, 0.0))
            out = np.where(sweep.new, 0.0, out) + np.where(sweep.known, back, 0.0)
        return np.where(self.held, 0.0, out)

    def means(self, values: Array) -> Array:
        """Means of neighbouring values at the redundant multipliers that are means.

        They have the shape of the values, and are 0 elsewhere.
        """
        out = np.zeros_like(values)
        for sweep in self._sweeps:
            out += self._around(np.where(sweep.known, values, 0.0)) * sweep.part
        return out

    def entries(self, numbers: Indices, factor: Array) -> tuple[Indices, Indices, Array]:
        """Derivative of a factor times :meth:`means`: rows, columns and values of this rank.

        Args:
            numbers: Numbers of the multipliers in a larger system, of the shape of the multipliers.
            factor: The factor, of the same shape.
        """
        found = []
        for sweep in self._sweeps:
            for columns in self._columns:
                number = self._at_corners(numbers[:, columns].astype(np.float64) + 1.0)
                part = self._at_corners((factor * sweep.part)[:, columns])
                known = self._at_corners(sweep.known[:, columns].astype(np.float64)) > 0
                shape = (*number.shape[:2], *number.shape[1:])
                row = np.broadcast_to(number[:, :, None], shape).astype(np.int64) - 1
                column = np.broadcast_to(number[:, None], shape).astype(np.int64) - 1
                value = np.where(known[:, None], part[:, :, None], 0.0)
                some = value != 0
                found.append((row[some], column[some], value[some]))
        row, column, value = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return row, column, value

    def _at_corners(self, values: Array) -> Array:
        """Values of multipliers at the vertices of this rank's facets, 0 where there are none."""
        vec = self._slave.create_vec()
        local = PETSc.Vec().createSeq(len(self._corners), comm=PETSc.COMM_SELF)
        here = PETSc.IS().createGeneral(self._corners.astype(PETSc.IntType), PETSc.COMM_SELF)
        scatter = PETSc.Scatter().create(vec, here, local, None)
        vec.array[self._at - vec.owner_range[0]] = values
        scatter.scatter(vec, local)
        out = np.array(local.array_r).reshape(self._shape)
        for thing in (vec, local, here, scatter):
            thing.destroy()
        return out

    def _around(self, values: Array) -> Array:
        """Sums over adjacent facets of the values at their vertices: a symmetric matrix."""
        vecs = [self._slave.create_vec() for _ in range(2)]
        local = PETSc.Vec().createSeq(len(self._corners), comm=PETSc.COMM_SELF)
        here = PETSc.IS().createGeneral(self._corners.astype(PETSc.IntType), PETSc.COMM_SELF)
        scatter = PETSc.Scatter().create(vecs[0], here, local, None)
        at, out = self._at - vecs[0].owner_range[0], np.zeros_like(values)
        for columns in self._columns:
            for vec in vecs:
                vec.zeroEntries()
            vecs[0].array[at] = values[:, columns]
            scatter.scatter(vecs[0], local)
            corners = local.array_r.reshape(self._shape)
            around = np.broadcast_to(corners.sum(axis=1, keepdims=True), self._shape)
            local.array[:] = around.ravel()
            mode = PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE
            scatter.scatter(local, vecs[1], *mode)
            out[:, columns] = vecs[1].array_r[at]
        for thing in (*vecs, local, here, scatter):
            thing.destroy()
        return out
