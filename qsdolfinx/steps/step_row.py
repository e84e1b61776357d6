"""Numbers of the last step of any run, for tables."""

from __future__ import annotations

from qsdolfinx.base.checks import check, instance
from qsdolfinx.steps.stepper import TimeStepper


def step_row(stepper: TimeStepper) -> dict[str, float]:
    """Return the main numbers of the last step as a table row. Collective.

    Returns:
        Step, time, Δt, Newton iterations and failed attempts; for each contact the force on the
        slave, the area in contact and the deepest penetration; and the volume of each mesh. For 2D
        bodies the values are per length, so that volumes in the plane are areas. For axisymmetric
        bodies they are those of the whole ring, 2π ∫ r dA. A body is axisymmetric if a surface of
        its contacts is. The volume of a displacement-based body is that of its reference mesh,
        which does not change.
    """
    check(instance(TimeStepper, "a TimeStepper"), stepper=stepper)
    row: dict[str, float] = {
        "step": stepper.num_steps,
        "t": stepper.t,
        "dt": stepper.last_dt,
        "iterations": stepper.num_iterations,
        "cutbacks": stepper.num_cutbacks,
    }
    for i, contact in enumerate(stepper.problem.contacts):
        force = contact.force("slave")
        row |= {f"force_{i}_{axis}": float(f) for axis, f in zip("xyz", force, strict=False)}
        row[f"area_{i}"] = contact.patch()[0]
        row[f"penetration_{i}"] = contact.penetration()
    for i, motion in enumerate(stepper.motions):
        row[f"volume_{i}"] = motion.volume()
    return row
