"""What every run can say of its last step, for tables."""

from __future__ import annotations

from qsdolfinx.base.checks import check, instance
from qsdolfinx.steps.stepper import TimeStepper


def step_row(stepper: TimeStepper) -> dict[str, float]:
    """What every run can say of its last step. Collective.

    Returns:
        Step, time, Δt, Newton iterations and failed attempts; for each contact the force on the
        slave, the area in contact and the deepest penetration; the volume of each mesh. Of 2D
        bodies these are per length, in plane volumes are areas; of axisymmetric ones they are those
        of the whole ring, 2π ∫ r dA. The volume of a body in displacements is that of its reference
        mesh, which does not change. A body is axisymmetric if a surface of its contacts is.
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
