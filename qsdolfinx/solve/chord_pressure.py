"""Estimate the error of contact pressures due to chord errors of facets on curved surfaces."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set
from qsdolfinx.contact.advice import FEW, bent, flat_sides
from qsdolfinx.contact.model import ChordGaps, ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.pair import degree_of_rule, find_conforming
from qsdolfinx.solve.newton import Newton

Array = npt.NDArray[np.float64]

#: Root mean square of the pressure error due to chord errors, over the mean pressure, above which a
#: solve warns. With less, meshes whose results are good would get a warning:
#: ``tests/contact/test_warnings.py``.
NOTICED = 0.1

#: Pressure that presses the chord errors flat within facets, over the mean pressure, above which a
#: solve warns. Contact quadrature points then open, and pressures of rings of two meshes are wrong
#: by 10 %, root mean square: ``tests/contact/test_chord_errors.py``.
OPENS = 2.0


def find_chord_pressure(newton: Newton, model: ContactModel) -> str | None:
    """Warning text if chord errors of facets make pressures wrong; None otherwise. Collective.

    Where facets of both sides approximate surfaces that are curved the same way, the gap of a node
    is wrong by δ, the difference to the gap of the curved surfaces. The resulting pressure error
    follows from the last tangent, K du = −Gᵀ S λ' δ and dλ = λ' (δ + G du). The variation of δ from
    node to node is pressed flat; its mean matters in relation to the approach of the bodies. With
    constraints at points the variation of δ within facets, times γ, matters as well: where it
    exceeds the pressure, points open.

    Args:
        newton: Newton's method, at a solution.
        model: A contact of its system.
    """
    if model.chord_gaps is None:
        model.chord_gaps = _chord_gaps(model)
    gap = model.gaps[0]
    own = model.chord_gaps.of_nodes * _on_nodes(gap, _resolved(gap))
    pressure = _on_nodes(gap, gap.multiplier(model.eps)[:, 0])
    area = np.where(pressure > 0, model.slave.node_area, 0.0)
    total, force, squares = _sums(model, area, area * pressure, area * own**2)
    if total == 0.0 or squares == 0.0 or model.compliance == 0.0:  # or all nodes are constrained
        return None
    opening = model.eps * model.chord_gaps.spread * total / force
    if gap.rows.are_points and opening > OPENS:
        return (
            "facets: where the surfaces are curved the same way, chord errors vary by "
            f"{model.chord_gaps.spread:.2g} within facets. Pressing them flat would take "
            f"{opening:.2g} times the mean pressure: contact opens within facets, and pressures "
            f"are wrong: take {bent(model.settings)}"
        )
    # Upper bound of the error: a node is stiffest if it moves alone.
    if np.sqrt(squares * total) <= NOTICED * model.compliance * force:
        return None
    change = _on_nodes(gap, _response(newton, model, gap.rows.from_nodes(own)))
    error = float(np.sqrt(_sums(model, area * change**2)[0] * total) / force)
    if error <= NOTICED:
        return None
    return (
        "facets: where the surfaces are curved the same way, chord errors of facets of "
        f"{np.sqrt(squares / total):.2g} make pressures wrong by {error:.0%} of their mean: take "
        + bent(model.settings)
    )


def _sums(model: ContactModel, *values: Array) -> Array:
    sums = np.array([value.sum() for value in values])
    model.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    return sums


def _response(newton: Newton, model: ContactModel, change: Array) -> Array:
    """Change of λ on the first integration side for a change of its gaps, (rows,). Collective."""
    system, gap = newton.system, model.gaps[0]
    slope = active_set.slope(model, gap)
    vecs = [body.create_vec() for body in system.bodies]
    sides = system.sides[system.contacts.index(model)]
    of_bodies = vecs[sides[0]], None if sides[1] is None else vecs[sides[1]]
    slave, master = model.ordered(gap, of_bodies)
    assert slave is not None
    try:
        gap.add_forces((-slope * change)[:, None], (slave, master))
        parts = []
        for body, vec in zip(system.bodies, vecs, strict=True):
            part: Array = np.zeros(body.num_owned)
            part[body.free] = vec.array_r[body.free]
            parts.append(part)
        if not system.tangent_fits():
            newton.assemble()
        solution, reason = newton.linear.solve(np.concatenate(parts))
        if reason < 0:  # as if each node moved alone, which is stiffest
            return np.where(slope > 0, change / model.compliance, 0.0)
        for vec, part in zip(vecs, system.parts(solution), strict=True):
            vec.array[:] = part
        return np.asarray(slope * (change + gap.change_of((slave, master))[:, 0]))
    finally:
        for vec in vecs:
            vec.destroy()


def _on_nodes(gap: WeightedGap, values: Array) -> Array:
    return np.asarray(gap.rows.on_nodes(values, 0.0), dtype=np.float64)


def _resolved(gap: WeightedGap) -> Array:
    """Part of the initial gap of each constraint that is not allowed for by adjustment, (rows,)."""
    allowance = gap.allowance
    depth = np.maximum(-gap.operator.initial_gap, allowance)
    some = allowance > 0
    return 1 - np.divide(allowance, depth, out=np.zeros_like(depth), where=some)


def _chord_gaps(model: ContactModel) -> ChordGaps:
    """δ at the slave's owned nodes, and its variation within facets. Collective."""
    none = ChordGaps(np.zeros(len(model.slave.node_area)), 0.0)
    sampling, master, slave = model.settings.sampling, model.master, model.slave
    exact = master.is_analytic and sampling.quadrature == "nodal"
    if exact or not any(flat_sides(model.settings)):
        return none
    degree = degree_of_rule(slave, master, follows=False)
    found = find_conforming(slave, master, degree, model.paired.radius, sampling.follows)
    if found.part < FEW:
        return none
    bulge = found.bulges @ np.array([1.0, -1.0])
    count, first, second = _sums(model, np.ones(len(bulge)), bulge, bulge**2)
    spread = float(np.sqrt(max(second / count - (first / count) ** 2, 0.0)))
    gap = WeightedGap(slave, master, found.points, model.law, 1.0, rows="cover", augmented=False)
    values = gap.rows.on_nodes(gap.operator.initial_gap, np.nan)
    return ChordGaps(np.nan_to_num(np.asarray(values, dtype=np.float64)), spread)
