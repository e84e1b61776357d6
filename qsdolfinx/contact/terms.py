"""Contributions of a contact to the equations: gaps, forces, tangent. All are collective.

For a rigid tool, None takes the place of objects of the master's body.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set
from qsdolfinx.contact.coupling import ConductanceCoupling
from qsdolfinx.contact.model import BlocksOf, ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.laws import Conductance
from qsdolfinx.gap.weighted_gap import WeightedGap

#: Stiffness of the constraints of a gap; or of a slip, together with its coupling to the gap.
Weights = npt.NDArray[np.float64] | tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]


def evaluate(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Compute gaps and slips for the unknowns of the two bodies."""
    model.physics.look(model)
    model.evaluated_at, model.is_evaluated, model.kept = model.num_pairings, True, None
    with model.watch.stage("gap"):
        for gap in model.gaps:
            gap.evaluate(model.ordered(gap, (slave, master)))
        model.physics.evaluate(model, slave, master)


def add_residual(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Add the virtual work of contact at the last evaluation to both bodies' residuals.

    The virtual work is ∂Φ/∂u plus that of friction; for temperatures it is minus the frictional
    heat.
    """
    with model.watch.stage("gap"):
        multipliers = [gap.multiplier(model.eps) for gap in model.gaps]
        for gap, multiplier in zip(model.gaps, multipliers, strict=True):
            gap.add_forces(multiplier, model.ordered(gap, (slave, master)))
        for slip in model.slips:
            slip.add_forces(model.ordered(slip.gap, (slave, master)))
        if model.friction_heat is not None:
            model.friction_heat.add_to((slave, master))


def add_tangent(model: ContactModel, blocks: BlocksOf) -> None:
    """Add the derivative of the residual to the blocks, without assembling them.

    For gaps with updated geometry only the stiffness term is added, for estimates: these gaps are
    solved for together with multipliers, see ``system.derivative``.
    """
    with model.watch.stage("insertion"):
        for gap in model.gaps:
            slope = active_set.slope(model, gap)
            gap.add_stiffness(slope, _ordered(model, gap.slave is model.slave, blocks), False)
        for slip in model.slips:
            if slip.gap.following is None:
                slope = active_set.slope(model, slip.gap)
                slip.add_stiffness(slope, _ordered(model, slip.slave is model.slave, blocks))
        if model.coupling is not None:
            model.coupling.add_to(blocks, False)


def _changes(model: ContactModel) -> bool:
    """Whether conductances depend on unknowns: temperatures, or also displacements."""
    law = model.law
    if not isinstance(law, Conductance):
        return False
    return law.of_temperature or (law.of_state and model.with_bodies)


def add_pattern(model: ContactModel, blocks: BlocksOf) -> None:
    """Add zeros at all places where :func:`add_tangent` may add entries."""
    with model.watch.stage("insertion"):
        for gap in model.gaps:
            none = np.zeros(gap.num_rows)
            gap.add_stiffness(none, _ordered(model, gap.slave is model.slave, blocks), True)
        if model.coupling is not None:
            model.coupling.destroy()
        model.coupling = ConductanceCoupling(model) if _changes(model) else None
        if model.coupling is not None:
            model.coupling.add_to(blocks, True)


def has_factors(model: ContactModel) -> bool:
    """Whether Gᵀ W G is the best form of the tangent, with G constant until contact is updated.

    This requires few constraints: at nodes, not at points, which are far more numerous.
    """
    if _changes(model):
        return False
    return all(gap.is_linear and not gap.rows.are_points for gap in model.gaps)


def gaps_and_slips(model: ContactModel) -> list[tuple[WeightedGap | Slip, Weights]]:
    """All gaps and slips, and the stiffness of their constraints (force per length).

    The stiffness of a gap is an array of shape (rows,) or (rows, width), that of a slip the result
    of its ``stiffness``.
    """
    with model.watch.stage("insertion"):
        out: list[tuple[WeightedGap | Slip, Weights]] = [
            (gap, gap.stiffness(active_set.slope(model, gap))) for gap in model.gaps
        ]
        slips = model.slips
        out += [(slip, slip.stiffness(active_set.slope(model, slip.gap))) for slip in slips]
    return out


def _ordered(model: ContactModel, as_given: bool, blocks: BlocksOf) -> BlocksOf:
    return blocks if as_given else (blocks[3], blocks[2], blocks[1], blocks[0])


def constrain(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Mark the unknowns with Dirichlet conditions by nonzero entries."""
    for part in model.parts:
        gap = part.gap if isinstance(part, Slip) else part
        part.constrain(*model.ordered(gap, (slave, master)))
