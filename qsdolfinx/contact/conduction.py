"""Conductances and frictional heat of contact of scalar fields. All functions are collective.

They include the functions of ``model.Physics``; those of bodies are in ``contact.bodies``.
"""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.handles import handle_of
from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel, Paired
from qsdolfinx.gap.friction_heat import FrictionHeat
from qsdolfinx.gap.laws import Conductance
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]

#: Kind of the finding about gaps that are too wide to be paired.
WIDE = "wide gaps"

#: Conductance over the largest present conductance below which a gap counts as not conducting.
#: Beyond the search distance it is set to 0: with more, this would change the flux unseen.
NOTHING = 1e-2


def begin(model: ContactModel, paired: Paired) -> None:
    """Prepare new contact pairs for their first evaluation."""
    law, gap = model.law, paired.gaps[0]
    if not isinstance(law, Conductance):
        return
    model.penalty.source = "h of each point takes its place"
    if law.friction is not None:
        model.friction_heat = FrictionHeat(gap.slave, gap.master, gap.points, law.friction)


def look(model: ContactModel) -> None:
    """Check and use numbers that the user may have changed, before gaps are evaluated.

    Raises:
        ValueError: If a number is out of range, or differs between ranks.
        RuntimeError: If the bodies' contact has not been solved since its contact pairs were
            updated.
    """
    law, gap, mechanics = model.law, model.gaps[0], model.mechanics
    if not isinstance(law, Conductance):
        return
    with checked(model.comm) as same:
        same(**law.numbers)
        if mechanics is not None and (law.of_state or law.friction is not None):
            of = mechanics.of
            solved = of.penalty.value is not None and of.evaluated_at == of.num_pairings
            text = "mechanics: the bodies have been paired and not solved for since"
            require(solved, f"{text}: solve their problem first", RuntimeError)
            step, theirs = model.kinematics.dt, of.kinematics.dt
            alike = law.friction is None or step is None or theirs in (None, step)
            require(alike, f"dt: is {step}, but dt of the contact in mechanics is {theirs}")
    gap.state.shift = np.full((gap.num_rows, 1), -law.tool_temperature)


def evaluate(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Compute h, and the power of friction, after the gaps have been evaluated."""
    law, gap = model.law, model.gaps[0]
    own = gap.operator.apply(slave.handle, handle_of(master), (1.0, 0.0))[:, 0]
    least, largest = np.min(own, initial=np.inf), np.max(own, initial=-np.inf)
    model.field_range = np.array([-least, largest], dtype=np.float64)
    if not isinstance(law, Conductance):
        return
    state = _state(model, law, gap, slave, master) if law.of_state else ()
    model.conduction_state = state
    with collective_errors(model.comm):  # h may be user code
        gap.state.conductance = law.values(gap.num_rows, state)
    if law.of_state and WIDE not in model.told:
        _advise(model, law, gap)
    if model.friction_heat is not None:
        assert model.mechanics is not None
        dt = model.kinematics.dt or model.mechanics.of.kinematics.dt
        assert dt is not None
        model.friction_heat.power = np.asarray(model.mechanics.dissipation() / dt, np.float64)


def _advise(model: ContactModel, law: Conductance, gap: WeightedGap) -> None:
    """Warn once if h still conducts at the search radius, beyond which nothing is paired."""
    assert model.mechanics is not None
    radius = model.mechanics.of.paired.search_radius
    wide, present = gap.points.num_unpaired, gap.state.conductance
    assert present is not None
    wide = model.comm.allreduce(wide, op=MPI.SUM)
    largest = model.comm.allreduce(float(np.max(present, initial=0.0)), op=MPI.MAX)
    if wide == 0:
        return
    temperatures = [np.full(1, law.tool_temperature)] * (2 if law.of_temperature else 0)
    with collective_errors(model.comm):
        there = float(law.values(1, (np.zeros(1), np.full(1, radius), *temperatures))[0])
    if there > NOTHING * largest:
        tell(
            model,
            WIDE,
            f"h: {wide} nodes have no partner within the search radius {radius:.3g}, at which h is "
            f"still {there:.3g}; the flow across wider gaps is neglected: give the contact in "
            "mechanics a search_radius above the widest gap that conducts",
        )


def _state(
    model: ContactModel,
    law: Conductance,
    gap: WeightedGap,
    slave: PETSc.Vec,
    master: PETSc.Vec | None,
) -> tuple[Array, ...]:
    """Arguments of h at the points: pressure, distance and, if needed, temperatures."""
    mechanics = model.mechanics
    assert mechanics is not None
    pressure = mechanics.pressure()
    if mechanics.shares_pairs:
        distance = mechanics.distance()
    else:
        pressure = gap.rows.from_nodes(pressure)
        distance = np.maximum(np.asarray(gap.points.gap), 0.0)
    if not law.of_temperature:
        return pressure, distance
    own = gap.operator.apply(slave.handle, handle_of(master), (1.0, 0.0))[:, 0]
    return pressure, distance, own, own - gap.state.values[:, 0]
