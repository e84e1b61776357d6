"""Report of a contact as a table of numbers, the same on all ranks."""

from __future__ import annotations

import dataclasses
import textwrap

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact import results
from qsdolfinx.contact.active_set import num_closed
from qsdolfinx.contact.advice import bent, chords
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.depth import DeepPlace, deepest
from qsdolfinx.contact.fields import faced
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.penalty import EXTREME, MODERATE, Penalty
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SideReport:
    """One side of a contact.

    Attributes:
        nodes: Contact nodes.
        area: Area (2D: length); None for a rigid tool.
        facet_sizes: Smallest and largest facet (length).
        found: Nodes that found a partner; None if no partner is searched for the nodes.
    """

    nodes: int
    area: float | None
    facet_sizes: tuple[float, float]
    found: int | None

    @property
    def missed(self) -> int | None:
        """Nodes that found no partner; None if no partner is searched for the nodes."""
        return None if self.found is None else self.nodes - self.found

    def __str__(self) -> str:
        low, high = self.facet_sizes
        text = f"{self.nodes} nodes, facets {low:.3g} to {high:.3g}"
        if self.area is not None:
            text += f", area {self.area:.4g}"
        return text if self.found is None else f"{text}; {self.found} paired, {self.missed} not"


@dataclasses.dataclass(frozen=True)
class ContactReport:
    """Report that :meth:`qs.Contact.report` returns; ``print`` shows it as a table.

    Attributes:
        slave: The slave's side.
        master: The master's side; None for a tool with an analytic shape.
        points: Contact quadrature points of all integration sides.
        covered: Area that the contact quadrature points represent over the area of the slave. With
            nodal quadrature, a master that extends beyond the slave can make it more than 1.
        missed_facets: On the overlay, facets that found no partner; else 0.
        gap: Smallest and largest weighted gap at the last evaluation (length, positive in
            penetration; for tied contact the size of the relative displacement); None if nothing is
            paired.
        weighted_penetration: :meth:`qs.Contact.weighted_penetration` (length).
        penetration: True penetration, :meth:`qs.Contact.penetration` (length); None if a deformed
            facet has no area.
        deepest: Up to three places of deepest penetration, not beside each other.
        advice: Advice if an augmented Lagrangian has closed the weighted gaps, but the true
            penetration is more than a hundredth of the smallest facet; otherwise empty.
        active: Active constraints (at nodes with a multiplier, or at points); None before the first
            solve with an automatic penalty.
        rows: Number of constraints.
        touching: Corners of the smallest box around the slave's nodes in contact, at their deformed
            positions, each of shape (gdim,); None if no node is in contact.
        slipping: Nodes in contact that slip; None without friction.
        unloaded: Nodes of the master within the search distance of the slave that never receive a
            force, because no contact quadrature point of a multiplier is beside them.
        penalty: ε (stress per length); None until an automatic penalty is computed.
        penalty_source: How the penalty was chosen.
        stiffness_ratio: ε over the stiffness of the softer body's contact nodes, the mean of
            K_kk / S_k; None before the first solve.
        overclosure: Penetration at the first contact detection (length).
        treatment: How this penetration is treated, see ``initial_overclosure``.
        search_radius: Search distance (length) beyond which nothing is paired.
        method: Formulation, quadrature, normals and constraints.
        law: Law, enforcement and friction.
        motion: Unknowns of the bodies, and Δt.
        is_scalar: Whether fields are scalar; gaps are then the differences of the field.
    """

    slave: SideReport
    master: SideReport | None
    points: int
    covered: float
    missed_facets: int
    gap: tuple[float, float] | None
    weighted_penetration: float
    penetration: float | None
    deepest: tuple[DeepPlace, ...]
    advice: str
    active: int | None
    rows: int
    touching: tuple[tuple[float, ...], tuple[float, ...]] | None
    slipping: int | None
    unloaded: int
    penalty: float | None
    penalty_source: str
    stiffness_ratio: float | None
    overclosure: float
    treatment: str
    search_radius: float
    method: str
    law: str
    motion: str
    is_scalar: bool = False

    @property
    def conditioning(self) -> str:
        """Effect of the ratio of penalty to stiffness on gaps and linear solvers, in words."""
        ratio = self.stiffness_ratio
        if ratio is None:
            return "penalty / stiffness is known after the first solve"
        text = f"penalty / stiffness of the softer side {ratio:.3g}: "
        if ratio < 1:
            return text + "soft, gaps are as large as the deformation of a layer of cells"
        if ratio <= MODERATE:
            return text + "moderate, any linear solver"
        if ratio < EXTREME:
            return text + "stiff, iterative solvers take several times the iterations"
        return text + f"errors of direct solvers up to {1e-15 * ratio:.0e}, iterative solvers fail"

    def _depths(self) -> list[tuple[str, str]]:
        """Lines on how deep the surfaces are in each other, where, and what to do about it."""
        depth = "unknown, a deformed facet has no area"
        if self.penetration is not None:
            depth = f"{self.penetration:.4g}"
        text = f"{depth}; of weighted gaps {self.weighted_penetration:.4g}"
        places = [("" if i else "deepest", str(place)) for i, place in enumerate(self.deepest)]
        return [("penetration", text), *places, *([("", self.advice)] if self.advice else [])]

    def __str__(self) -> str:
        parts = [f"{self.points} points, {100 * self.covered:.4g} % of the slave's area"]
        if self.missed_facets:
            parts.append(f"{self.missed_facets} facets without a partner")
        active = f"not solved yet, {self.rows} constraints"
        if self.active is not None:
            active = f"{self.active} of {self.rows} constraints"
        if self.touching is not None:
            ends = ["(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in self.touching]
            active += f", from {ends[0]} to {ends[1]}"
        if self.slipping:
            active += f", {self.slipping} nodes slip"
        unloaded = "0"
        if self.unloaded:
            overlay = "" if "overlay" in self.method else 'use quadrature="overlay", or '
            unloaded = f"{self.unloaded} master nodes: {overlay}swap sides"
        penalty = "" if self.penalty is None else f"{self.penalty:.6g}, "
        gap = "none" if self.gap is None else "{:.4g} to {:.4g}".format(*self.gap)
        made = [
            ("contact", self.method),
            ("law", self.law),
            ("unknowns", self.motion),
            ("slave", str(self.slave)),
            ("master", "analytic shape" if self.master is None else str(self.master)),
            ("pairing", ", ".join([*parts, f"search radius {self.search_radius:.4g}"])),
        ]
        if self.is_scalar:
            return _table([*made, ("jump", gap), ("penalty", penalty + self.penalty_source)])
        lines = [
            *made,
            ("weighted gap", gap),
            *self._depths(),
            ("active", active),
            ("unloaded", unloaded),
            ("penalty", penalty + self.penalty_source),
            ("conditioning", self.conditioning),
            ("overclosure", f"{self.overclosure:.4g} at first, {self.treatment}"),
        ]
        return _table(lines)


def _table(lines: list[tuple[str, str]]) -> str:
    lines = [
        ("" if i else name, part)
        for name, text in lines
        for i, part in enumerate(textwrap.wrap(text, 110) or [""])
    ]
    return "\n".join(f"{name:13}{text}" for name, text in lines)


def make_report(model: ContactModel, penalty: Penalty) -> ContactReport:
    """Read a contact's numbers; only sums, minima and maxima go between ranks. Collective.

    Args:
        model: The contact, as the last solve left it.
        penalty: Its penalty now.
    """
    counts = np.array(
        [
            sum(p.points.size for p in model.gaps),
            sum(p.points.num_unpaired for p in model.of_sides),
            sum(p.num_rows for p in model.gaps),
            0 if model.penalty.value is None else num_closed(model),
            sum(int(np.count_nonzero(slip.slipping)) for slip in model.slips),
        ]
    )
    points, unpaired, rows, active, slipping = model.comm.allreduce(counts).tolist()
    weight = model.comm.allreduce(float(model.gaps[0].points.weight.sum()))
    overlay = model.settings.sampling.quadrature == "overlay"
    dt = "" if model.kinematics.dt is None else f", dt {model.kinematics.dt:.6g}"
    friction = "no friction" if model.friction is None else f"friction {model.friction.law!r}"
    settings, sampling = model.settings, model.settings.sampling
    enforcement = "augmented-lagrangian" if model.augmented else "penalty"
    slave = _side(model, model.slave)
    assert slave is not None
    weighted = results.weighted_penetration(model)
    depth, places, advice = _depth(model)
    return ContactReport(
        slave,
        _side(model, model.master),
        points,
        weight / model.slave.area,
        unpaired if overlay else 0,
        _gap_range(model),
        weighted,
        depth,
        places,
        advice,
        None if model.penalty.value is None else active,
        rows,
        _touching(model),
        slipping if model.slips else None,
        _unloaded(model),
        penalty.value,
        penalty.source,
        _stiffness_ratio(penalty),
        model.overclosure.depth,
        _treatment(model),
        model.paired.search_radius,
        f"{settings.formulation}, {sampling.quadrature}, {_normals(model)}, "
        f"constraints at {settings.constraints}",
        f"{type(model.law).__name__}, {enforcement}, {friction}",
        f"{_unknowns(model)}{dt}",
        model.is_scalar,
    )


def _normals(model: ContactModel) -> str:
    """Along which gaps are measured; finite sliding has rays from both surfaces."""
    sampling, finite = model.settings.sampling, model.settings.sliding == "finite"
    return f"{sampling.normals if finite else sampling.normals_to(model.master)} normals"


def _unknowns(model: ContactModel) -> str:
    if model.is_scalar:
        return "scalar field"
    return " and ".join(dict.fromkeys(model.kinematics.unknown))


def _touching(model: ContactModel) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Corners of the box around the slave's nodes in contact. Collective."""
    if model.penalty.value is None:
        return None
    active = results.active(model, "slave")
    try:
        facets = model.placement.slave.facets()
    except ValueError:  # on all ranks
        return None
    at = np.searchsorted(facets.node_dofs[:, 0], model.slave.node_dofs[:, 0])
    x = np.asarray(facets.node_x)[at][active, : model.slave.gdim]
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([low, -high])
    model.comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MIN)
    if not np.isfinite(corners).all():
        return None
    low, high = corners[: len(low)], -corners[len(low) :]
    return tuple(low.tolist()), tuple(high.tolist())


def _side(model: ContactModel, surface: AnySurface) -> SideReport | None:
    if surface.is_analytic:
        return None
    nodes = len(surface.search_object(model.slave).node_x)
    area = next((body.area for body in surface.bodies), None)
    found = _found(model, surface)
    total = model.comm.allreduce(np.array([nodes, 0 if found is None else found]))
    return SideReport(
        int(total[0]), area, surface.facet_size_range, None if found is None else int(total[1])
    )


def _found(model: ContactModel, surface: AnySurface) -> int | None:
    """Nodes of this rank that found a partner."""
    first = model.gaps[0]
    if surface is model.slave or len(model.of_sides) > 1:
        p = first if surface is model.slave else model.of_sides[1]
        overlay = model.settings.sampling.quadrature == "overlay"
        return len(p.rows.reached) if overlay else _at_slave(p)
    if (
        model.settings.sampling.quadrature == "nodal"
        and model.settings.formulation == "quasi-symmetric"
    ):
        return first.points.size - _at_slave(first)
    return None


def _at_slave(p: WeightedGap) -> int:
    """Points of this rank that were found for nodes of the slave: they have one vertex alone."""
    return int(np.count_nonzero(p.points.slave["owner"][:, 1] < 0))


def _gap_range(model: ContactModel) -> tuple[float, float] | None:
    gaps = np.concatenate([p.sizes for p in model.gaps])
    low = model.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=MPI.MIN)
    high = model.comm.allreduce(float(np.max(gaps, initial=-np.inf)), op=MPI.MAX)
    return (low, high) if low <= high else None


def _depth(model: ContactModel) -> tuple[float | None, tuple[DeepPlace, ...], str]:
    """True penetration, where it is deepest, and what to do about it. Collective."""
    if not model.has_gaps:
        return results.penetration(model), (), ""
    try:
        depth, places = results.penetration(model), tuple(deepest(model))
    except ValueError:  # on all ranks
        return None, (), ""
    return depth, places, _advice(model, depth)


def _advice(model: ContactModel, depth: float) -> str:
    """What to do about penetration that weighted gaps hide; a penalty leaves some anyway."""
    if not model.augmented:
        return ""
    settings = model.settings
    at_points = settings.constraints == "points"
    if not at_points:
        # Weighted gaps are closed up to some per cent of the depth.
        if results.mean_penetration(model) > max(model.allowed_gap, 0.05 * depth):
            return ""
    if depth - model.overclosure.allowed <= NOTICED * model.paired.facet_size:
        return ""
    cure = "take finer facets"
    if chords(model):
        return f"facets approximate curves: {cure}, or {bent(settings)}"
    if at_points:
        return f"facets are too coarse for the other surface, their points penetrate: {cure}"
    cure += ', or constraints="points"'
    if settings.sampling.quadrature != "overlay":
        cure += ' with quadrature="overlay"'
    return f"weighted gaps are closed, but points penetrate: {cure}"


def _unloaded(model: ContactModel) -> int:
    """Nodes of the master that face the slave within the radius, and no force reaches."""
    p, bodies = model.gaps[0], model.master.bodies
    is_meant = model.type in ContactType.NORMAL | ContactType.TIE
    if not bodies or len(model.of_sides) > 1 or not is_meant:
        return 0
    master = bodies[0].linear
    surfaces = master.cpp_object, model.slave.linear.cpp_object
    near = _cpp.pair_surfaces(*surfaces, False, model.paired.radius, 0).slave["dofs"][:, 0, 0]
    reached = faced(p, np.zeros(p.num_rows)).reached
    alone = np.isin(master.node_dofs[:, 0], near) & ~reached
    return int(model.comm.allreduce(int(np.count_nonzero(alone))))


def _stiffness_ratio(penalty: Penalty) -> float | None:
    if penalty.value is None or not penalty.stiffness or min(penalty.stiffness) == 0:
        return None
    return penalty.value / min(penalty.stiffness)


def _treatment(model: ContactModel) -> str:
    if not model.has_gaps:
        return "which a tie keeps"
    allowed = model.overclosure.part
    return f'"{model.overclosure.treatment}", {100 * allowed:.4g} % of it allowed'
