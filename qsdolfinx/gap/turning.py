"""Co-rotated gaps between tied surfaces, which turn with the facets of the master."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.gap.following import Destination, Vecs
from qsdolfinx.gap.tie import Places
from qsdolfinx.surface.affine import trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.surface.unknowns import CORNERS, EDGES

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
#: Real numbers, or complex ones for derivatives by complex steps.
Numbers = npt.NDArray[typing.Any]

#: Imaginary step (length) of derivatives by a facet's tangents: the relative error, the square of
#: the step over the size of the facet, is below rounding. See ``test_derivative`` of
#: tests/gap/test_tie_across_gap.py.
STEP = 1e-30


@dataclasses.dataclass(frozen=True)
class Turned:
    """Rotation of gaps at given positions of the surfaces.

    Attributes:
        operator: Derivative of the mean of x_slave − x_master − R d at these positions.
        moved: Mean of −(R − 1) d, shape (rows, gdim).
        nodes: Positions of the nodes of each point's facets, on both sides, (points, nodes, 3).
    """

    operator: _cpp.GapOperator
    moved: Array
    nodes: list[Array]


class Turning:
    """Co-rotated gaps between two surfaces that are tied across a gap.

    A point of the slave is tied to a point of the master across a gap d = x_slave − x_master. Both
    are material points. Their relative displacement is x_slave − x_master − R d, with the rotation
    R of the master's facet. Therefore a common rotation of the bodies causes no strain, and a tie
    transmits the moment of its force over the gap: the work of R d is that of a couple on the
    facet. A point that was found for a node of the master has no facet of the master; its gap turns
    with the slave's facet.

    R maps the facet's reference normal N to the present normal n. About n, it is the rotation in
    the polar decomposition of the facet's deformation: with E₁, E₂ orthonormal on the facet when it
    was tied and f₁, f₂ their present images, R E₁ is along f₁ − n × f₂.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        points: Contact quadrature points between the two surfaces.
        places: Positions of both surfaces.
    """

    def __init__(
        self, slave: Surface, master: Surface, points: _cpp.PairingPoints, places: Places
    ) -> None:
        self._surfaces, self._points = (slave, master), points
        #: The slave when it is tied: relative displacements stay means over its areas then.
        self._tied_slave = slave.twin()
        sides = points.slave, points.master
        self._sides = [_Side(s, side) for s, side in zip(self._surfaces, sides, strict=True)]
        #: Whether each point turns with the slave, and with the master.
        on_master = self._sides[1].on_facet
        self._with = ~on_master, on_master
        x = self._at_points(places)
        gap = x[0] - x[1]
        none = ROUNDING * min(s.facet_size_range[0] for s in self._surfaces)
        gap[np.linalg.norm(gap, axis=1) <= none] = 0.0
        #: Gap d of each point in the frame of its facet, (points, 3).
        self._local: list[Array] = []
        #: Maps derivatives on the reference facet to those along E₁ and E₂, (points, 2, 2).
        self._along: list[Array] = []
        for side, nodes in zip(self._sides, self._nodes(places), strict=True):
            tangents = side.tangents(nodes)
            self._along.append(_orthonormal(tangents))
            frame = side.frame(tangents, self._along[-1])[0]
            self._local.append(np.einsum("pai,pi->pa", frame, gap))
        self._gap = gap
        largest = float(np.max(np.abs(gap), initial=0.0))
        #: Whether there is any gap, on any rank.
        self.any = bool(slave.comm.allreduce(largest, op=MPI.MAX) > 0)
        self._sums: _cpp.GapOperator | None = None

    def at(self, places: Places, plain: _cpp.GapOperator, rows: int) -> Turned:
        """Rotation of the gaps with the surfaces at these positions. Collective.

        Args:
            places: Positions of both surfaces.
            plain: Operator of the relative displacement without co-rotated gaps.
            rows: Kind of constraints, see ``WeightedGap``.
        """
        gdim, turn, nodes = self._surfaces[0].gdim, [], self._nodes(places)
        gaps = self._turned(nodes)
        for side, along, x, gap in zip(self._sides, self._along, nodes, gaps, strict=True):
            turn.append(-side.variation(x, along, gap)[..., :gdim, :gdim])
        points = self._points.turning(*(np.ascontiguousarray(t) for t in turn))
        slave, master = self._tied_slave, self._surfaces[1].cpp_object
        operator = _cpp.GapOperator(slave, master, points, jump=True, rows=rows)
        return Turned(operator, self._moved(gaps, plain), nodes)

    def add_curvature(
        self, at: Turned, forces: Array, plain: _cpp.GapOperator, markers: Vecs, to: Destination
    ) -> None:
        """Add the derivative of the couples of constant forces, −Σ f·∂²(R d)/∂x². Collective.

        Args:
            at: The last evaluation.
            forces: Forces f on the constraints, (rows, gdim).
            plain: As for :meth:`at`.
            markers: Vectors of both bodies, nonzero at unknowns with Dirichlet conditions.
            to: Destination.
        """
        gdim, force = self._surfaces[0].gdim, self._at_sides(forces, plain)
        for i, side in enumerate(self._sides):
            held = side.values(markers[i])[..., :gdim] != 0
            some = np.flatnonzero(self._with[i] & np.any(self._local[i] != 0, axis=1))
            dofs = np.where(held, -1, side.dofs)[some]
            H = side.curvature(
                at.nodes[i][some], self._along[i][some], self._local[i][some], force[some], some
            )
            numbers = to.numbers[i](dofs.reshape(len(some), int(np.prod(dofs.shape[1:]))))
            to.sums.add_squares(numbers, -to.scale[i] * H[:, :, :gdim, :, :gdim])

    def _at_sides(self, forces: Array, plain: _cpp.GapOperator) -> Array:
        """Transposed of :meth:`_mean`, applied to forces on the constraints, (points, 3)."""
        slave, node = self._surfaces[0], plain.row_node
        sums, vec = self._sum_operator(), slave.create_vec()
        weight, out = np.asarray(self._points.weight), np.zeros((len(self._gap), 3))
        own = slave.node_dofs[node] - vec.owner_range[0]
        for i in range(slave.gdim):
            vec.zeroEntries()
            vec.array[own] = (forces[:, i] / plain.row_area)[:, None]
            out[:, i] = weight * sums.at_points(vec.handle)
        vec.destroy()
        return out

    def moved(self, places: Places, plain: _cpp.GapOperator) -> Array:
        """``Turned.moved`` with the surfaces at these positions. Collective."""
        return self._moved(self._turned(self._nodes(places)), plain)

    def _moved(self, gaps: list[Array], plain: _cpp.GapOperator) -> Array:
        return -self._mean(gaps[0] + gaps[1] - self._gap, plain)[:, : self._surfaces[0].gdim]

    def _turned(self, nodes: list[Array]) -> list[Array]:
        """R d on each side, of the points that turn with it and 0 for others, (points, 3)."""
        out = []
        for i, side in enumerate(self._sides):
            frame = side.frame(side.tangents(nodes[i]), self._along[i])[0]
            gap = np.einsum("pai,pa->pi", frame, self._local[i])
            out.append(np.where(np.asarray(self._with[i])[:, None], gap, 0.0))
        return out

    def _nodes(self, places: Places) -> list[Array]:
        """Positions of the nodes of each point's facets, on both sides. Collective."""
        out = []
        for side, surface, x in zip(self._sides, self._surfaces, places, strict=True):
            assert x is not None
            vec = trace_vec(surface, x[..., : surface.gdim])
            out.append(side.values(vec))
            vec.destroy()
        return out

    def _at_points(self, places: Places) -> list[Array]:
        return [
            np.einsum("pj,pjd->pd", side.N, x)
            for side, x in zip(self._sides, self._nodes(places), strict=True)
        ]

    def _mean(self, values: Array, plain: _cpp.GapOperator) -> Array:
        """Weighted means of vectors at the points, (rows, 3). Collective."""
        slave, sums = self._surfaces[0], self._sum_operator()
        weighted = np.asarray(self._points.weight)[:, None] * values
        out, node = np.zeros((plain.num_rows, 3)), plain.row_node
        vec = slave.create_vec()
        for i in range(slave.gdim):
            vec.zeroEntries()
            sums.add_to_nodes(np.ascontiguousarray(weighted[:, i]), vec.handle)
            of_sides = vec.array_r[slave.node_dofs[node] - vec.owner_range[0]]
            out[:, i] = of_sides.sum(axis=1) / plain.row_area
        vec.destroy()
        return out

    def _sum_operator(self) -> _cpp.GapOperator:
        """Operator with a row for each point. Collective at the first call."""
        if self._sums is None:
            objects = self._surfaces[0].cpp_object, self._surfaces[1].cpp_object
            self._sums = _cpp.GapOperator(*objects, self._points, jump=False, rows=2)
        return self._sums


class _Side:
    """Facets of one surface on which the points are.

    Args:
        surface: The surface.
        side: Side of the contact quadrature points on this surface.
    """

    def __init__(self, surface: Surface, side: dict[str, typing.Any]) -> None:
        self._gdim = surface.gdim
        dofs, self.N = np.asarray(side["dofs"]), np.asarray(side["shape_values"])
        used = np.asarray(side["owner"]) >= 0
        #: Whether a point is on a facet, not only at a node; shape (points,).
        self.on_facet: Flags = np.asarray(used.all(axis=1))
        #: Unknowns of each point's nodes, −1 where a node is not used, (points, nodes, gdim).
        self.dofs = dofs.astype(np.int64)
        known = np.where(dofs >= 0, dofs, dofs[:, :1])  # entries that are not used
        self.values = TraceValues(surface, known)
        nv = surface.num_facet_vertices
        corners = CORNERS[nv]
        reference = [*corners, *(corners[[a, b]].mean(axis=0) for a, b in EDGES[nv])]
        reference.append(corners.mean(axis=0))
        xi = self.N @ np.array(reference)[: self.N.shape[1]]
        #: Derivatives of the trace's functions, (points, nodes, 2).
        self._dN = np.asarray(_cpp.trace_gradients(nv, surface.degree, xi))

        #: The same without those that leave the tangents constant: along z in 2D, and all of points
        #: that are not on a facet.
        self._slopes = np.where(self.on_facet[:, None, None], self._dN, 0.0)
        if self._gdim == 2:
            self._slopes[:, :, 1] = 0.0

    def tangents(self, nodes: Array, which: Indices | slice = slice(None)) -> Array:
        """Derivatives of positions on the reference facet, (points, 2, 3); in 2D the second is z.

        For points that are not on a facet, they are those of a facet in the plane of x and y.

        Args:
            nodes: Positions of the nodes of selected points.
            which: Numbers of these points; all by default.
        """
        out = np.einsum("pja,pji->pai", self._dN[which], nodes)
        if self._gdim == 2:
            out[:, 1] = [0.0, 0.0, 1.0]
        out[~self.on_facet[which]] = np.eye(3)[:2]
        return np.asarray(out)

    @staticmethod
    def frame(tangents: Numbers, along: Array) -> tuple[Numbers, Numbers]:
        """R E₁, R E₂ and n as rows, (points, 3, 3), and |f₁ − n × f₂|, (points,)."""
        f = along @ tangents
        n = _unit(np.cross(f[:, 0], f[:, 1]))
        first = f[:, 0] - np.cross(n, f[:, 1])
        e = _unit(first)
        return np.stack([e, np.cross(n, e), n], axis=1), _length(first)

    def variation(self, nodes: Array, along: Array, gap: Array) -> Array:
        """Matrices from displacements of a facet's nodes to those of R d, (points, nodes, 3, 3).

        Args:
            nodes: Positions of the nodes.
            along: As for :meth:`frame`.
            gap: R d, shape (points, 3).
        """
        by_tangents = self._by_tangents(self.tangents(nodes), along, gap)
        return np.asarray(np.einsum("pja,paik->pjik", self._slopes, by_tangents))

    def _by_tangents(self, tangents: Numbers, along: Array, gap: Numbers) -> Numbers:
        """Matrices from changes of the facet's tangents a₁ and a₂ to those of R d.

        R d moves by θ × R d with θ = n × δn + n δφ, δn = −Σ a^α (n·δa_α), where a^α are the
        reciprocal tangents, and δφ = (R E₂·δf₁ − R E₁·δf₂) / |f₁ − n × f₂|.

        Args:
            tangents: The tangents, (points, 2, 3).
            along: As for :meth:`frame`.
            gap: R d, shape (points, 3).

        Returns:
            Shape (points, 2, 3, 3); the last index is that of the change.
        """
        frame, size = self.frame(tangents, along)
        e, n = frame[:, :2], frame[:, 2]
        metric = np.linalg.inv(np.einsum("pai,pbi->pab", tangents, tangents))
        reciprocal = np.einsum("pab,pbi->pai", metric, tangents)
        tilt = np.cross(np.cross(n[:, None], reciprocal), gap[:, None])  # along −(n·δa)
        of_f = along / size[:, None, None]
        turn = of_f[:, 0, :, None] * e[:, None, 1] - of_f[:, 1, :, None] * e[:, None, 0]
        couple = np.einsum("pi,pak->paik", np.cross(n, gap), turn)
        return np.asarray(couple - np.einsum("pai,pk->paik", tilt, n))

    def curvature(
        self, nodes: Array, along: Array, local: Array, force: Array, which: Indices
    ) -> Array:
        """Second derivatives of f·R d by the nodes of facets, (points, nodes, 3, nodes, 3).

        R depends on the nodes only by the tangents of the facet at the point. The second derivative
        by these is the derivative of :meth:`_by_tangents` by imaginary steps, which is exact to
        rounding.

        Args:
            nodes: Positions of the nodes of selected points.
            along: As for :meth:`frame`.
            local: d in the frame of the facet, (points, 3).
            force: f, (points, 3).
            which: Numbers of these points.
        """
        slopes = self._slopes[which]
        tangents, by_tangents = self.tangents(nodes, which), np.zeros((len(nodes), 2, 3, 2, 3))
        for a in range(self._gdim - 1):
            for i in range(self._gdim):
                moved = tangents.astype(np.complex128)
                moved[:, a, i] += 1j * STEP
                gap = np.einsum("pai,pa->pi", self.frame(moved, along)[0], local)
                change = self._by_tangents(moved, along, gap).imag / STEP
                by_tangents[:, :, :, a, i] = np.einsum("pi,paik->pak", force, change)
        half = np.einsum("paibk,pja->pjibk", by_tangents, slopes)
        return np.asarray(np.einsum("pjibk,pmb->pjimk", half, slopes))


def _length(vectors: Numbers) -> Numbers:
    """Lengths of real vectors, as analytic functions of their components."""
    return np.asarray(np.sqrt(np.sum(vectors * vectors, axis=1)))


def _unit(vectors: Numbers) -> Numbers:
    return np.asarray(vectors / _length(vectors)[:, None])


def _orthonormal(tangents: Array) -> Array:
    """Matrices that make the tangents (points, 2, 3) orthonormal, (points, 2, 2)."""
    metric = np.einsum("pai,pbi->pab", tangents, tangents)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(metric)))
