"""Results of the fold demo: force, energies, symmetry, penetration."""

import dataclasses

import numpy as np

from common.command import say
from common.measures import columns


@dataclasses.dataclass
class Row:
    """The state at a stroke."""

    stroke: float  # displacement of each plane
    force: float  # force on a plane, mean of both
    net_force: float  # force on both planes together
    elastic: float
    dissipated: float
    asymmetry: float
    penetration: float
    facet_size: float
    touching: float  # length of the spring's contact with itself
    iterations: int
    cutbacks: int

    def say(self):
        """Print it, on rank 0."""
        say(
            f"stroke {self.stroke:.4f}  force {self.force:.6f}  touching {self.touching:.2f}  "
            f"asymmetry {self.asymmetry:.1e}  iterations {self.iterations}"
        )


def measure(stroke, iterations, spring, contacts, stepper):
    """Compute the row of this state. Collective."""
    *planes, itself = contacts
    above, below = (contact.force("master")[1] for contact in planes) if stroke else (0.0, 0.0)
    return Row(
        stroke,
        force=(above - below) / 2,
        net_force=abs(above + below),
        elastic=spring.energy(),
        dissipated=itself.dissipated_energy(),
        asymmetry=spring.asymmetry(),
        penetration=itself.penetration() if stroke else 0.0,
        facet_size=spring.facet_size,
        touching=itself.patch()[0] if stroke else 0.0,
        iterations=iterations,
        cutbacks=stepper.num_cutbacks,
    )


def work_of(rows):
    """Work of both planes, by Simpson's rule on pairs of equal steps."""
    force, stroke = columns(rows, "force", "stroke")
    means = (force[:-2:2] + 4 * force[1::2] + force[2::2]) / 6
    return 2 * means @ np.diff(stroke[::2])


def symmetry_error(rows):
    """The largest asymmetry over the stroke."""
    return max(row.asymmetry for row in rows) / rows[-1].stroke


def energy_error(rows):
    """Compute the error of the energy balance at the end, over the work."""
    end, work = rows[-1], work_of(rows)
    return abs(work - end.elastic - end.dissipated) / work


def summary(rows, finer):
    """Return the results for --json from the rows of both meshes."""
    end = rows[-1]
    (force,), (fine,) = columns(rows, "force"), columns(finer, "force")
    return {
        "force": end.force,
        "force_change": np.abs(force - fine).max() / np.abs(fine).max(),
        "symmetry_error": symmetry_error(rows),
        "energy_error": energy_error(rows),
        "max_penetration": max(row.penetration for row in rows),
        "facet_size": end.facet_size,
        "snes_iterations": sum(row.iterations for row in rows + finer),
    }


def more(rows, finer):
    """Return further results to be printed, of both meshes."""
    out = {}
    for name, each in (("", rows), (", finer mesh", finer)):
        end, work = each[-1], work_of(each)
        out[f"symmetry error{name}"] = symmetry_error(each)
        out[f"energy error{name}"] = energy_error(each)
        out[f"max penetration / facet size{name}"] = (
            max(row.penetration for row in each) / end.facet_size
        )
        out[f"force on the middle / force{name}"] = max(row.net_force for row in each) / end.force
        out[f"length in contact{name}"] = end.touching
        out[f"work of friction / work{name}"] = end.dissipated / work
        out[f"cutbacks{name}"] = end.cutbacks
    return out
