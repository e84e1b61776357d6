"""Shallow ironing: a hard indenter with a circular edge, pressed into a soft slab and dragged.

After Fischer & Wriggers (2006), Yastrebov (2013) and Poulios & Renard (2015). Plane strain,
neo-Hookean quadrilaterals, ν = 0.3: a slab (E = 1, height 1, clamped at its bottom) with facets of
--h, and an indenter (E = 10, about 1.6 × 0.8, lower edge of radius 4) with facets of ratio × h,
which match those of the slab nowhere. The indenter's top is displaced downwards by --depth, and
then dragged along the slab, with Coulomb friction. The indenter is the slave (--swap: the slab).

    python3 demos/ironing.py --formulation quasi-symmetric --json ironing.json
    mpirun -n 2 python3 demos/ironing.py --quadrature nodal --formulation master-slave
    python3 demos/ironing.py --plot ironing.png

The plateau is the last 12 facets of the slide, after some 4 facets until full slip. Its number of
steps is coprime to 12, so that each step ends at another position within a facet. (Fx, Fy) is the
force on the indenter's top. Keys of the JSON object:

- force_ratio_error: |mean of |Fx/Fy| over the plateau / μ − 1|;
- force_oscillation: (largest − smallest Fx) / mean of Fx, over the plateau;
- steps: total number of steps, --steps and those added by cutbacks;
- cutbacks: number of failed attempts.
"""

import dataclasses
import math
import pathlib
import sys
import warnings

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures
from common.command import Command, option, report
from ironing_bodies import create_bodies
from ironing_output import Record, columns

PRESSING, RUN_IN = 6, 4  # steps, facets of the slab


@dataclasses.dataclass
class Parameters:
    """One ironing; lengths in units of the slab's height, stresses in its Young's modulus."""

    formulation: str = option("quasi-symmetric")
    quadrature: str = option("overlay")
    enforcement: str = option("penalty", "the default is as accurate here, and faster")
    penalty: float | None = option(None, "ε, stress per length")
    mu: float = option(0.3)
    h: float = option(0.1, "facet size of the slab")
    ratio: float = option(1.37, "facet size of the indenter over h")
    depth: float = option(0.06)
    steps: int = option(119, "number of steps, pressing and run-in included")
    facets: int = option(12, "length of the plateau in facets of the slab")
    sliding: str = option("small", "finite: contact geometry is updated in the step")
    constraints: str | None = option(None, "nodes or points; finite sliding needs points")
    swap: bool = option(False, "make the slab the slave")
    output: str | None = option(None, "write fields, history.csv", metavar="FOLDER")
    verbose: bool = False

    def __post_init__(self):
        if self.mu <= 0:
            raise ValueError("--mu: must be positive")
        if (self.sliding, self.constraints) == ("finite", "nodes"):
            warnings.warn("--constraints: finite sliding has points", stacklevel=2)
            self.constraints = "points"
        self.plan()

    def plan(self):
        """Steps of the run-in and of the plateau."""
        sliding = self.steps - PRESSING
        plateau = sliding * self.facets // (self.facets + RUN_IN)
        if self.sliding == "finite":  # a step may slide by several facets
            plateau = min(max(plateau, 2), sliding - 1)
        while self.sliding == "small" and math.gcd(plateau, self.facets) > 1:
            plateau -= 1
        if plateau < (2 * self.facets if self.sliding == "small" else 2):
            raise ValueError(f"steps: {self.steps} are less than two per facet of the slide")
        return sliding - plateau, plateau


def build(comm, p):
    """Build indenter, slab, contact, and the stepper, whose time counts steps."""
    bodies = indenter, slab = create_bodies(comm, p.h, p.ratio, (RUN_IN + p.facets) * p.h)
    surfaces = [body.surface for body in bodies]
    contact = qs.Contact(
        *(surfaces[::-1] if p.swap else surfaces),
        formulation=p.formulation,
        penalty="auto" if p.penalty is None else p.penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        gap_tolerance=1e-6,
        friction=qs.Coulomb(p.mu),
        sliding=p.sliding,
        constraints=p.constraints,
    )
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )

    def drive(t, dt):
        depth, slide = p.depth * min(t / PRESSING, 1), max(t - PRESSING, 0)
        indenter.displacement.value[:] = slide * p.facets / p.plan()[1] * p.h, -depth

    return indenter, slab, contact, qs.TimeStepper(problem, 1.0, drive)


def on_plateau(p, rows):
    """Return columns of the rows of the plateau, and of the row before it."""
    first = next(i for i, row in enumerate(rows) if row.t > PRESSING + p.plan()[0] + 1e-6)
    return columns(rows[first:]), rows[first - 1]


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Iron; return (JSON, all rows, scene). Calls ``on_step(row, scene)`` after each step."""
    scene = *_, stepper = build(comm, p)
    record = Record(comm, p, scene)
    for end in np.cumsum([PRESSING, *p.plan()]):
        for _ in stepper.run(float(end)):
            record.add_step()
            if on_step is not None:
                on_step(record.rows[-1], scene)
    record.close()
    slide, _ = on_plateau(p, record.rows)  # means over the slide, independent of the steps
    ratio, mean = (np.average(f, weights=slide.dt) for f in (np.abs(slide.fx / slide.fy), slide.fx))
    result = {
        "force_ratio_error": float(abs(ratio / p.mu - 1)),
        "force_oscillation": float(np.ptp(slide.fx) / abs(mean)),
        "steps": stepper.num_steps,
        "cutbacks": stepper.num_cutbacks,
    }
    return result, record.rows, scene


def main():
    p, a = Command(__doc__, Parameters, plot="draw three kinds of contact").parse()
    if a.plot:
        pictures.ironing(a.plot, dataclasses.replace(p, output=None), run, on_plateau)
    if a.json or p.output or not a.plot:
        report(run(dataclasses.replace(p, verbose=not a.plot))[0], a.json, ".6g")


if __name__ == "__main__":
    main()
