"""What a contact is and does, in numbers that are the same on all ranks, as a table."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.fields import faced
from qsdolfinx.contact.penalty import EXTREME, MODERATE
from qsdolfinx.contact.results import TWO_PASSES
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import RigidSurface

if typing.TYPE_CHECKING:
    from qsdolfinx.contact.contact import Contact

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SideReport:
    """One side of a contact.

    Attributes:
        nodes: Contact nodes.
        area: Area (2D: length); None of a rigid tool.
        facet_sizes: Smallest and largest facet (length).
        found: Nodes that found a partner; None if the side's nodes are not searched for one.
    """

    nodes: int
    area: float | None
    facet_sizes: tuple[float, float]
    found: int | None

    @property
    def missed(self) -> int | None:
        """Nodes that found no partner; None if they are not searched for one."""
        return None if self.found is None else self.nodes - self.found

    def __str__(self) -> str:
        low, high = self.facet_sizes
        text = f"{self.nodes} nodes, facets {low:.3g} to {high:.3g}"
        if self.area is not None:
            text += f", area {self.area:.4g}"
        return text if self.found is None else f"{text}; {self.found} paired, {self.missed} not"


@dataclasses.dataclass(frozen=True)
class ContactReport:
    """What :meth:`qs.Contact.report` returns; ``print`` shows it as a table.

    Attributes:
        slave: The slave's side.
        master: The master's, None of a tool with an analytic shape.
        points: Pairing points, of all passes.
        covered: Area that the points stand for over the area of the slave. At nodes a master that
            goes on beyond the slave can make it more than 1.
        missed_facets: On the overlay, facets that found no partner; else 0.
        gap: Smallest and largest weighted gap at the last evaluation (length, positive in
            penetration; of tied contact the size of the jump); None if nothing is paired.
        active: Rows (nodes with a multiplier) in contact; None before the first solve with an
            automatic penalty.
        rows: Rows.
        slipping: Active rows that slip; None without friction.
        unloaded: Nodes of the master within reach of the slave that no force can ever load,
            because no pairing point of a multiplier is beside them.
        penalty: ε (stress per length), None before an automatic one is computed.
        penalty_source: How it was chosen.
        stiffness_ratio: ε over the stiffness of the softer body's contact nodes, the mean of
            K_kk / S_k; None before the first solve.
        overclosure: Penetration at the first pairing (length).
        treatment: What becomes of it, ``initial_overclosure``.
        search_radius: Distance (length) beyond which nothing is paired.
        method: Formulation, quadrature and normals.
        law: Law, enforcement and friction.
        motion: Unknowns of the bodies, and Δt.
    """

    slave: SideReport
    master: SideReport | None
    points: int
    covered: float
    missed_facets: int
    gap: tuple[float, float] | None
    active: int | None
    rows: int
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

    @property
    def conditioning(self) -> str:
        """What penalty over stiffness means for gaps and for linear solvers."""
        ratio = self.stiffness_ratio
        if ratio is None:
            return "penalty / stiffness is known after the first solve"
        text = f"penalty / stiffness of the softer side {ratio:.3g}: "
        if ratio < 1:
            return text + "soft, gaps as large as the strain of a layer of cells"
        if ratio <= MODERATE:
            return text + "moderate, any linear solver"
        if ratio < EXTREME:
            return text + 'stiff, direct solver; for "amg" take an augmented Lagrangian'
        return text + f"a direct solver's error may be {1e-15 * ratio:.0e}, iterative ones fail"

    def __str__(self) -> str:
        parts = [f"{self.points} points, {100 * self.covered:.4g} % of the slave's area"]
        if self.missed_facets:
            parts.append(f"{self.missed_facets} facets without a partner")
        active = f"{'?' if self.active is None else self.active} of {self.rows} rows"
        if self.slipping:
            active += f", {self.slipping} of them slip"
        unloaded = "0"
        if self.unloaded:
            unloaded = f'{self.unloaded} master nodes: use quadrature="overlay", or swap sides'
        penalty = "" if self.penalty is None else f"{self.penalty:.6g}, "
        lines = {
            "contact": self.method,
            "law": self.law,
            "unknowns": self.motion,
            "slave": str(self.slave),
            "master": "analytic shape" if self.master is None else str(self.master),
            "pairing": ", ".join([*parts, f"search radius {self.search_radius:.4g}"]),
            "gap": "none" if self.gap is None else "{:.4g} to {:.4g}".format(*self.gap),
            "active": active,
            "unloaded": unloaded,
            "penalty": penalty + self.penalty_source,
            "conditioning": self.conditioning,
            "overclosure": f"{self.overclosure:.4g} at first, {self.treatment}",
        }
        return "\n".join(f"{name:13}{text}" for name, text in lines.items())


def make_report(contact: Contact) -> ContactReport:
    """Read a contact's numbers; only sums, minima and maxima go between ranks. Collective."""
    counts = np.array(
        [
            sum(p.points.size for p in contact.passes),
            sum(p.points.num_unpaired for p in contact.passes),
            sum(len(p.row_node) for p in contact.passes),
            0 if contact.penalty is None else contact.num_active_local(),
            sum(int(np.count_nonzero(slip.slipping)) for slip in contact.slips),
        ]
    )
    points, unpaired, rows, active, slipping = contact.comm.allreduce(counts).tolist()
    weight = contact.comm.allreduce(float(contact.passes[0].points.weight.sum()))
    overlay = contact.quadrature == "overlay"
    dt = "" if contact.dt is None else f", dt {contact.dt:.6g}"
    friction = "no friction" if contact.friction is None else f"friction {contact.friction!r}"
    slave = _side(contact, contact.slave)
    assert slave is not None
    return ContactReport(
        slave,
        _side(contact, contact.master),
        points,
        weight / contact.slave.area,
        unpaired if overlay else 0,
        _gap_range(contact),
        None if contact.penalty is None else active,
        rows,
        slipping if contact.slips else None,
        _unloaded(contact),
        contact.penalty,
        contact.penalty_source,
        _stiffness_ratio(contact),
        contact.overclosure.depth,
        _treatment(contact),
        contact.search_radius,
        f"{contact.formulation}, {contact.quadrature}, {contact.normals} normals",
        f"{type(contact.law).__name__}, {contact.enforcement}, {friction}",
        f"{' and '.join(dict.fromkeys(contact.unknown))}{dt}",
    )


def _side(contact: Contact, surface: Surface | RigidSurface) -> SideReport | None:
    if isinstance(surface, RigidSurface):
        if surface.is_analytic:
            return None
        nodes, area = len(surface.facets(contact.slave.axisymmetric).node_x), None
    else:
        nodes, area = len(surface.node_x), surface.area
    found = _found(contact, surface)
    total = contact.comm.allreduce(np.array([nodes, 0 if found is None else found]))
    return SideReport(
        int(total[0]), area, surface.facet_size_range, None if found is None else int(total[1])
    )


def _found(contact: Contact, surface: Surface | RigidSurface) -> int | None:
    """Nodes of this rank that found a partner."""
    first = contact.passes[0]
    if surface is contact.slave or contact.formulation in TWO_PASSES:
        p = first if surface is contact.slave else contact.passes[1]
        return len(p.row_node) if contact.quadrature == "overlay" else _at_slave(p)
    if contact.quadrature == "nodal" and contact.formulation == "quasi-symmetric":
        return first.points.size - _at_slave(first)
    return None


def _at_slave(p: WeightedGap) -> int:
    """Points of this rank that were found for nodes of the slave: they have one vertex alone."""
    return int(np.count_nonzero(p.points.slave["owner"][:, 1] < 0))


def _gap_range(contact: Contact) -> tuple[float, float] | None:
    sizes = [np.linalg.norm(p.values, axis=1) if p.law.jump else p.values for p in contact.passes]
    gaps = np.concatenate([values.ravel() for values in sizes])
    low = contact.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=MPI.MIN)
    high = contact.comm.allreduce(float(np.max(gaps, initial=-np.inf)), op=MPI.MAX)
    return (low, high) if low <= high else None


def _unloaded(contact: Contact) -> int:
    """Nodes of the master that face the slave within the radius, and no force reaches."""
    if isinstance(contact.master, RigidSurface) or contact.formulation in TWO_PASSES:
        return 0
    p, master = contact.passes[0], contact.master.linear
    surfaces = master._cpp_object, contact.slave.linear._cpp_object
    near = _cpp.pair_surfaces(*surfaces, False, contact.search_radius, 0).slave["dofs"][:, 0, 0]
    reached = faced(p, np.zeros(len(p.row_node))).reached
    alone = np.isin(master.node_dofs[:, 0], near) & ~reached
    return int(contact.comm.allreduce(int(np.count_nonzero(alone))))


def _stiffness_ratio(contact: Contact) -> float | None:
    if contact.penalty is None or not contact.stiffness or min(contact.stiffness) == 0:
        return None
    return contact.penalty / min(contact.stiffness)


def _treatment(contact: Contact) -> str:
    if contact.law.jump:
        return "which a tie keeps"
    allowed = contact.overclosure.part
    return f'"{contact.overclosure.treatment}", {100 * allowed:.4g} % of it allowed'
