"""Pressures of facets for curves: what chord errors make of the pressure that a solve has found."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.advice import FEW
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.pair import check_quadrature, find_conforming, pair
from qsdolfinx.pairing.relief import Smoothing, sides_of

Array = npt.NDArray[np.float64]

#: Error of pressure at nodes by chord errors, as a standard deviation over the mean pressure, that
#: is noticed: ``tests/contact/test_warnings.py``.
NOTICED = 0.1


def check_chords(model: ContactModel) -> None:
    """Warn, once and on all ranks, of pressures that are those of polygons. Collective.

    Where facets of both sides stand for surfaces that are curved the same way, the gap of a node is
    wrong by δ, the difference to that of the curved surfaces. The mean of δ over what is in contact
    is a clearance, which the first pairing has looked at. What it varies by from node to node is
    pressed flat: by pressures of δ over the compliance of the nodes.
    """
    if model.chords_warned or model.law.jump or model.is_scalar or model.with_itself:
        return
    if model.chord_gaps is None:
        model.chord_gaps = _chord_gaps(model)
    gap = model.gaps[0]
    own = model.chord_gaps * _on_nodes(gap, _resolved(gap))
    pressure = _on_nodes(gap, gap.multiplier(model.eps)[:, 0])
    area = np.where(pressure > 0, model.slave.node_area, 0.0)
    sums = np.array([area.sum(), area @ own, area @ pressure, area @ own**2])
    model.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    if sums[0] == 0.0 or sums[3] == 0.0 or model.compliance == 0.0:  # or conditions hold all of it
        return
    delta, mean, squares = sums[1:] / sums[0]
    varies = float(np.sqrt(max(squares - delta**2, 0.0)))
    error = varies / (model.compliance * mean)
    if error <= NOTICED:
        return
    warn(
        "facets: where the surfaces are curved the same way, chord errors of facets vary from node "
        f"to node by {varies:.2g}, which makes pressures wrong by {error:.0%} of their mean: take "
        + _cure(model),
        ContactWarning,
    )
    model.chords_warned = True


def _on_nodes(gap: WeightedGap, values: Array) -> Array:
    return np.asarray(gap.rows.on_nodes(values, 0.0), dtype=np.float64)


def _resolved(gap: WeightedGap) -> Array:
    """Part of the initial gap of each row that counts: allowances are parts of it, (rows,)."""
    allowance = gap.state.allowance
    depth = np.maximum(-gap.operator.initial_gap, allowance)
    some = allowance > 0
    return 1 - np.divide(allowance, depth, out=np.zeros_like(depth), where=some)


def _cure(model: ContactModel) -> str:
    curved = "meshes and displacements of degree 2"
    if model.settings.sliding == "finite":
        return curved
    overlay = ' with quadrature="overlay"'
    with_overlay = "" if model.settings.sampling.quadrature == "overlay" else overlay
    return f'smoothing="shared-curvature"{with_overlay}, or {curved}'


def _chord_gaps(model: ContactModel) -> Array:
    """δ at the slave's owned nodes, 0 where nothing is curved the same way. Collective."""
    none = np.zeros(len(model.slave.node_area))
    sampling, master, slave = model.settings.sampling, model.master, model.slave
    sides = (slave,) if master.is_analytic else (slave, master)
    exact = master.is_analytic and sampling.quadrature == "nodal"
    if exact or all(sampling.covers(side) for side in sides):
        return none
    degree = check_quadrature(slave, master, "overlay", None)
    radius = model.paired.radius
    if find_conforming(slave, master, degree, radius, sampling.smoothing).part < FEW:
        return none
    both = model.settings.formulation == "quasi-symmetric"
    curved, gaps = Smoothing(slave, master, sides_of("shared-curvature", master)), []
    for smoothing in (sampling.smoothing, curved):
        of = sampling._replace(quadrature="overlay", degree=degree, smoothing=smoothing)
        points = pair(slave, master, of, both, radius, True)
        gap = WeightedGap(slave, master, points, model.law, 1.0, rows="cover", augmented=False)
        values = gap.rows.on_nodes(gap.operator.initial_gap, np.nan)
        gaps.append(np.asarray(values, dtype=np.float64))
    return np.nan_to_num(gaps[0] - gaps[1])
