"""Gaps that follow the bodies: facets are cut anew wherever the unknowns put them."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.pairing.pair import overlay_rules
from qsdolfinx.surface.affine import trace_positions, trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues

Array = npt.NDArray[np.float64]
#: Of the slave and of the master: where the nodes of the trace are, (facets, nodes, 3).
Places = tuple[Array, Array]

#: Part of a node's area below which what its points cover does not count: D_k is at least that.
LEAST_COVER = 0.01

#: Way, in units of the largest facet, that facets may go before the pattern of the tangent has to
#: grow.
MARGIN = 0.5


@dataclasses.dataclass(frozen=True)
class Measure:
    """Where areas were measured last: they are constants until they are again.

    Attributes:
        places: Where the facets were.
        area: D_k, what points cover of each owned node's area, and LEAST_COVER of it at least.
        node_area: S_k.
    """

    places: Places
    area: Array
    node_area: Array


@dataclasses.dataclass(frozen=True)
class Cut:
    """What one evaluation has found.

    Attributes:
        places: Where the facets are.
        measure: With which areas.
        pieces: The pieces.
        rows: What they give to the nodes of the slave.
        operator: Derivative of the gaps G_k/D_k; its ``initial_gap`` is −G_k/D_k.
        covered: Owned nodes that points reach.
    """

    places: Places
    measure: Measure
    pieces: _cpp.Pieces
    rows: _cpp.PieceRows
    operator: _cpp.GapOperator
    covered: npt.NDArray[np.bool_]


class Following:
    """Cuts the facets of two deformable surfaces along each other, wherever they are.

    Half of the integral is over each surface: facet y of the one is cut along facet z of the other,
    which is projected along y's normal n. At a point of y that keeps its place ξ on the facet the
    gap is −t with x_z(ζ) = x_y(ξ) + t n, and

        G_k = ½ Σ_slave w N_k(ξ) g + ½ Σ_master w N_k(ζ) g,    ḡ_k = G_k / D_k.

    Areas in w and D_k are those of the last measure. Forces are derivatives of G_k with points that
    keep their places: each of them conserves momentum and moment.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        both: Whether facets of both are cut, each with half the weight.
        radius: Beyond which points are not paired.
        degree: Degree of the rule on the pieces.
    """

    def __init__(
        self, slave: Surface, master: Surface, both: bool, radius: _cpp.SearchRadius, degree: int
    ) -> None:
        self._surfaces = slave, master
        self._both, self._radius = both, radius
        self._rules = overlay_rules(slave.gdim, degree)
        self._values = TraceValues(slave), TraceValues(master)
        self._moving = slave.twin(), master.twin()
        self._measured = slave.twin(), master.twin()
        self._paired_at = self.pair()
        self._measured_at: Places | None = None
        self._last: Cut | None = None
        self._jump: tuple[Cut, _cpp.GapOperator] | None = None
        self._of_base: tuple[_cpp.GapOperator, Places, Array] | None = None
        self._marked: tuple[PETSc.Vec, PETSc.Vec] | None = None
        #: Columns of each row that the tangent has room for; None before there is one.
        self.pattern: _cpp.GapOperator | None = None

    def places(
        self,
        base: Places,
        u: tuple[PETSc.Vec | None, PETSc.Vec | None],
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> Places:
        """Where the nodes of the traces are for displacements over the scales. Collective."""
        first, second = (
            x + 0.0 if vec is None else x + s * values(vec)
            for x, vec, s, values in zip(base, u, scale, self._values, strict=True)
        )
        return first, second

    @property
    def radius(self) -> float:
        """Distance beyond which nothing is opposite."""
        return self._radius.largest

    def pair(self) -> Places:
        """Take the places where the surfaces were read last."""
        slave, master = self._surfaces
        self._paired_at = trace_positions(slave).copy(), trace_positions(master).copy()
        return self._paired_at

    def as_paired(self) -> Places:
        """Where they were when they were paired."""
        return self._paired_at

    def measure(self, places: Places) -> Measure:
        """Measure areas where the facets are. Collective."""
        slave = self._surfaces[0]
        self._measure_at(places)
        self._measured[0].measure_nodes()
        slave_area = np.asarray(self._measured[0].node_area)
        pieces = self._pieces(places)
        rows = _cpp.PieceRows(slave.cpp_object, pieces)
        area = np.maximum(rows.cover(len(slave_area)), LEAST_COVER * slave_area)
        return Measure(places, area, slave_area)

    def cut(self, places: Places, measure: Measure) -> Cut:
        """Pieces, gaps and their derivative with the facets at these places. Collective.

        Raises:
            ValueError: If places are not finite, or a ray of a curved facet meets no other.
        """
        last, comm = self._last, self._surfaces[0].comm
        same = last is not None and last.measure is measure and _equal(last.places, places)
        if comm.allreduce(same, op=MPI.LAND):
            assert last is not None
            return last
        with collective_errors(comm):
            for x in places:
                if not np.isfinite(x).all():
                    raise ValueError("displacements of contact facets are not finite")
        self._measure_at(measure.places)
        pieces = self._pieces(places)
        slave, master = (surface.cpp_object for surface in self._surfaces)
        rows = _cpp.PieceRows(slave, pieces)
        with collective_errors(comm):
            if rows.num_missed:
                raise ValueError(
                    f"{rows.num_missed} rays of curved contact facets meet no point of the facet "
                    "opposite: the facets are too curved for their size"
                )
        operator = _cpp.GapOperator(slave, master, rows, measure.area, jump=False)
        if self._marked is not None:
            operator.constrain(*(vec.handle for vec in self._marked))
        covered = np.asarray(rows.cover(len(measure.area)) > 0)
        self._last = Cut(places, measure, pieces, rows, operator, covered)
        return self._last

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        if self._marked is not None:
            for vec in self._marked:
                vec.destroy()
        self._marked = slave.copy(), master.copy()
        operators = [] if self._last is None else [self._last.operator]
        if self._jump is not None:
            operators.append(self._jump[1])
        for operator in operators:
            operator.constrain(slave.handle, master.handle)

    # --- Tangent

    def make_pattern(self, last: Cut) -> _cpp.GapOperator:
        """Rows with room for all pieces that facets may be cut into nearby. Collective."""
        slave, master = (surface.cpp_object for surface in self._surfaces)
        self._move(last.places)
        margin = MARGIN * max(surface.facet_size_range[1] for surface in self._moving)
        margin = max(margin, self._radius.largest)
        pieces = _cpp.nearby_pieces(*self._moving, self._both, margin)
        rows = _cpp.PieceRows(slave, pieces)
        self.pattern = _cpp.GapOperator(slave, master, rows, last.measure.area, jump=False)
        return self.pattern

    def jump_operator(self, last: Cut) -> _cpp.GapOperator:
        """The mean of x_slave − x_master with places on the facets that stay. Collective."""
        slave, master = (surface.cpp_object for surface in self._surfaces)
        if self._jump is None or self._jump[0] is not last:
            out = _cpp.GapOperator(slave, master, last.rows, last.measure.area, jump=True)
            if self._marked is not None:
                out.constrain(*(vec.handle for vec in self._marked))
            self._jump = last, out
        return self._jump[1]

    def jump_of_places(self, operator: _cpp.GapOperator, places: Places) -> Array:
        """What an operator of jumps gives for places of the facets' nodes. Collective."""
        known = self._of_base
        if known is None or known[0] is not operator or known[1] is not places:
            vecs = [
                trace_vec(surface, x[..., : surface.gdim])
                for surface, x in zip(self._surfaces, places, strict=True)
            ]
            known = operator, places, operator.apply(*(vec.handle for vec in vecs))
            for vec in vecs:
                vec.destroy()
            self._of_base = known
        return known[2]

    def add_slip_forces(
        self, last: Cut, traction: Array, b: tuple[PETSc.Vec, PETSc.Vec | None]
    ) -> None:
        """Add the forces of friction τ_k of the owned nodes, (nodes, gdim). Collective."""
        slave = self._surfaces[0]
        vec = slave.create_vec()
        vec.array[slave.node_dofs - vec.owner_range[0]] = traction
        handles = [0 if side is None else side.handle for side in b]
        _cpp.add_slip_forces(last.pieces, vec.handle, *handles)
        vec.destroy()

    def fits(self, last: Cut) -> bool:
        """Whether the pattern has room for these pieces, on this rank."""
        return self.pattern is None or bool(self.pattern.covers(last.operator))

    def add_curvature(
        self,
        last: Cut,
        multiplier: Array,
        blocks: typing.Sequence[int],
        scale: tuple[float, float],
    ) -> None:
        """Add Σ_k λ_k ∂²G_k to the blocks (ss, sm, ms, mm). Collective.

        Args:
            last: The last evaluation.
            multiplier: λ_k of the owned nodes, force over area.
            blocks: Handles of the matrices.
            scale: Displacement per unknown of both bodies.
        """
        assert self._marked is not None
        slave, master = self._surfaces
        vec = slave.create_vec()
        vec.array[slave.node_dofs[:, 0] - vec.owner_range[0]] = multiplier
        markers = self._marked[0].handle, self._marked[1].handle
        _cpp.insert_curvature(master.cpp_object, last.pieces, vec.handle, markers, blocks, scale)
        vec.destroy()

    # ---

    def _pieces(self, places: Places) -> _cpp.Pieces:
        self._move(places)
        return _cpp.overlay_pieces(
            *self._moving, *self._measured, self._both, self._radius, *self._rules
        )

    def _move(self, places: Places) -> None:
        for surface, x in zip(self._moving, places, strict=True):
            surface.follow(np.ascontiguousarray(x))

    def _measure_at(self, places: Places) -> None:
        if self._measured_at is not places:
            for surface, x in zip(self._measured, places, strict=True):
                surface.follow(np.ascontiguousarray(x))
            self._measured_at = places


def _equal(a: Places, b: Places) -> bool:
    return all(x is y or np.array_equal(x, y) for x, y in zip(a, b, strict=True))
