"""Results of the shaft demo: torque, balances, energies."""

import dataclasses

import numpy as np

from shaft_bodies import lame_pressure


@dataclasses.dataclass
class Row:
    """The state at an angle."""

    angle: float  # degrees
    torque: float
    net_moment: float
    net_force: float
    normal: float  # sum of the normal forces on the shaft
    radius: float  # mean radius of its facets in contact
    elastic: float
    dissipated: float
    iterations: int


def measure(angle, shaft, bore, contact, problem):
    """Compute the row of this state. Collective."""
    held, opposite = (body.load(body.held) for body in (shaft, bore))
    touching = shaft.load(shaft.touching)
    return Row(
        float(angle),
        torque=held.moment,
        net_moment=abs(held.moment + opposite.moment),
        net_force=np.linalg.norm(held.force + opposite.force),
        normal=-touching.outwards,
        radius=touching.radius * shaft.chord,
        elastic=shaft.energy() + bore.energy(),
        dissipated=contact.dissipated_energy(),
        iterations=problem.num_iterations,
    )


def summary(p, rows):
    """Return the results for --json from the rows of the run-in, if any, and of the steps."""
    end, steps = rows[-1], rows[-p.steps - 1 :]
    torque, angle = np.array([(row.torque, np.radians(row.angle)) for row in steps]).T
    work = 0.5 * (torque[1:] + torque[:-1]) @ np.diff(angle)
    stored, taken = end.elastic - steps[0].elastic, end.dissipated - steps[0].dissipated
    unit = abs(end.torque) if p.mu else end.normal * end.radius
    return {
        "moment_error": max(row.net_moment for row in rows) / unit,
        "force_error": max(row.net_force for row in rows) / end.normal,
        "work_error": abs(work - stored - taken) / (abs(work) if p.mu else end.elastic),
        "torque": end.torque,
        "steps": p.steps,
        "snes_iterations": sum(row.iterations for row in rows),
    }


def closed_forms(p, end):
    """Return pressure and torque, compared with their theoretical values."""
    pressure = end.normal / (2 * np.pi * end.radius)
    out = {"pressure": pressure, "pressure / Lamé": pressure / lame_pressure(p.interference)}
    if p.mu:
        out["torque / (μ N r)"] = abs(end.torque) / (p.mu * end.normal * end.radius)
    return out
