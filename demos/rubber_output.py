"""Results of the rubber demo: forces, displacements, penetration."""

import dataclasses

import numpy as np

from common.command import say


@dataclasses.dataclass
class Row:
    """The state after a step."""

    t: float
    force: float  # upward force on the lid or the roller
    drag: float  # force along x on the lid or the roller
    net_force: float  # force on all tools together, for a body held by tools only
    moved: float
    penetration: float
    iterations: int
    cutbacks: int

    def say(self):
        """Print it, on rank 0."""
        say(
            f"t {self.t:.2f}  force {self.force:.6f}  drag {self.drag:.6f}  "
            f"moved {self.moved:.5f}  penetration {self.penetration:.2e}  "
            f"iterations {self.iterations}"
        )


def measure(t, scene, contacts, stepper):
    """Compute the row of this state. Collective."""
    forces = np.array([contact.force("master") for contact in contacts])
    return Row(
        float(t),
        force=forces[0, 1],
        drag=forces[0, 0],
        net_force=0.0 if scene.body.bcs else np.linalg.norm(forces.sum(axis=0)),
        moved=scene.moved(),
        penetration=max(contact.penetration() for contact in contacts),
        iterations=stepper.num_iterations,
        cutbacks=stepper.num_cutbacks,
    )


def summary(rows, scene):
    """Return the results for --json."""
    return {
        "force": rows[-1].force,
        "u_x": rows[-1].moved,
        "max_penetration": max(row.penetration for row in rows),
        "facet_size": scene.body.facet_size,
        "snes_iterations": sum(row.iterations for row in rows),
    }


def more(p, rows):
    """Return further results to be printed."""
    end = rows[-1]
    out = {"cutbacks": end.cutbacks, "drag / force": abs(end.drag / end.force)}
    if p.scene == "oring":
        out["net force / force"] = max(row.net_force for row in rows) / end.force
        if p.distance:
            out["u_x / distance of the lid"] = end.moved / p.distance
    elif p.distance:
        out["u_x of a turn / -175.4"] = end.moved / p.distance / -175.4
    return out
