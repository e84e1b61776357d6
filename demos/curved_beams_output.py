"""Results of the curved beams demo: forces, energies, symmetry, kinks, penetration."""

import dataclasses

import numpy as np

from common.command import say
from common.measures import columns


@dataclasses.dataclass
class Row:
    """The state at a shift."""

    shift: float  # x of the upper beam's middle from the lower one's
    fx: float  # force on the upper beam's ends
    fy: float
    net_force: float  # force on the ends of both beams
    elastic: float  # elastic energy, with the penalty's energy
    dissipated: float
    penetration: float
    facet_size: float
    touching: float  # length of contact
    iterations: int
    cutbacks: int

    def say(self):
        """Print it, on rank 0."""
        say(
            f"shift {self.shift:7.3f}  force {self.fx:10.6f} {self.fy:10.6f}  "
            f"touching {self.touching:.2f}  iterations {self.iterations}"
        )


def measure(shift, iterations, upper, lower, contact, stepper):
    """Compute the row of this state. Collective."""
    force, opposite = upper.reaction(), lower.reaction()
    solved = stepper.num_steps > 0
    of_penalty = contact.stored_energy() if solved and not contact.model.augmented else 0.0
    return Row(
        shift,
        *force,
        net_force=np.abs(force + opposite).max(),
        elastic=upper.energy() + lower.energy() + of_penalty,
        dissipated=contact.dissipated_energy(),
        penetration=contact.penetration() if solved else 0.0,
        facet_size=min(upper.facet_size, lower.facet_size),
        touching=contact.patch()[0] if solved else 0.0,
        iterations=iterations,
        cutbacks=stepper.num_cutbacks,
    )


def forces(rows):
    """Return both reaction curves, shape (2, rows)."""
    return np.array(columns(rows, "fx", "fy"))


def largest_force(rows):
    """Return the largest absolute value of both components."""
    return np.abs(forces(rows)).max()


def force_change(rows, finer):
    """Compute the largest difference to the curves of another mesh, over the largest force."""
    return np.abs(forces(rows) - forces(finer)).max() / largest_force(finer)


def symmetry_error(rows):
    """Compute the largest difference of both curves to their mirror images, over the largest force.

    In the mirror image about the middle of the stroke fx changes its sign.
    """
    mirrored = forces(rows)[:, ::-1] * [[-1], [1]]
    return np.abs(forces(rows) - mirrored).max() / largest_force(rows)


def kink(rows):
    """Compute the largest fourth difference of both curves over 6, over the largest force.

    This is the distance of a force from the cubic through the two forces before and the two after
    it. For a smooth curve it scales with step⁴, at a kink with step × change of slope. All five
    states are in contact, because curves do have kinks where contact begins and ends.
    """
    (touching,) = columns(rows, "touching")
    inside = np.lib.stride_tricks.sliding_window_view(touching > 0, 5).all(axis=1)
    fourth = np.diff(forces(rows), 4, axis=1)[:, inside]
    return np.abs(fourth).max() / 6 / largest_force(rows)


def work_of(rows):
    """Integrate the work at the upper beam's ends up to every second row, by Simpson's rule."""
    fx, shift = columns(rows, "fx", "shift")
    means = (fx[:-2:2] + 4 * fx[1::2] + fx[2::2]) / 6
    return np.concatenate([[0.0], np.cumsum(means * np.diff(shift[::2]))])


def energy_error(rows):
    """Compute the largest error of the energy balance at any time, over the largest energy."""
    elastic, dissipated = columns(rows[::2], "elastic", "dissipated")
    return np.abs(work_of(rows) - elastic - dissipated).max() / (elastic + dissipated).max()


def summary(rows, finer):
    """Return the results for --json from the rows of both meshes."""
    fx, fy = np.abs(forces(rows)).max(axis=1)
    return {
        "force_x_max": fx,
        "force_y_max": fy,
        "force_change": force_change(rows, finer),
        "kink": kink(rows),
        "symmetry_error": symmetry_error(rows),
        "energy_error": energy_error(rows),
        "max_penetration": max(row.penetration for row in rows),
        "facet_size": rows[0].facet_size,
        "snes_iterations": sum(row.iterations for row in rows + finer),
    }


def more(rows, finer):
    """Return further results to be printed, of both meshes."""
    out = {}
    for name, each in (("", rows), (", finer mesh", finer)):
        out[f"largest elastic energy{name}"] = max(row.elastic for row in each)
        out[f"work{name}"] = work_of(each)[-1]
        out[f"energy taken by friction{name}"] = each[-1].dissipated
        out[f"max penetration / facet size{name}"] = (
            max(row.penetration for row in each) / each[0].facet_size
        )
        out[f"net force / force{name}"] = max(row.net_force for row in each) / largest_force(each)
        out[f"longest contact{name}"] = max(row.touching for row in each)
        out[f"iterations a step{name}"] = sum(row.iterations for row in each) / (len(each) - 1)
        out[f"cutbacks{name}"] = each[-1].cutbacks
    for measured in (kink, symmetry_error, energy_error):
        out[f"{measured.__name__.replace('_', ' ')}, finer mesh"] = measured(finer)
    return out
