"""Results of the ironing demo: forces, energies, and files."""

import typing

import numpy as np

import qsdolfinx as qs

from common.output import Output


class Row(typing.NamedTuple):
    """State after a step; force and work are those of the indenter's top."""

    t: float  # equals the number of steps, if none is cut back
    dt: float
    slide: float  # displacement in facets of the slab
    fx: float
    fy: float
    work: float
    dissipated: float
    elastic: float


def columns(rows):
    """The same of many steps, arrays."""
    return Row(*np.array(rows).T)


class Record:
    """Record of forces and energies, one row per step; with --output also history and fields.

    Args:
        comm: Communicator.
        p: Parameters.
        scene: What :func:`ironing.build` returns.
    """

    def __init__(self, comm, p, scene):
        self.indenter, self.slab, self.contact, self.stepper = scene
        self.h = p.h
        self.rows, self.last, self.work = [], np.zeros(4), 0.0
        self.output = Output(comm, p.output, p.steps, p.verbose)
        sides = ("master", "slave") if p.swap else ("slave", "master")
        for name, body, side in zip(("indenter", "slab"), scene[:2], sides, strict=True):
            fields = {"displacement": body.u, "stress": body.stress}
            self.output.add_fields(name, body.mesh, fields, self.contact.field_sources(side))

    def add_step(self):
        """Add a row; the work is computed with the trapezoidal rule. Collective."""
        now = np.append(self.indenter.reaction(), self.indenter.displacement.value)
        self.work += 0.5 * (now + self.last)[:2] @ (now - self.last)[2:]
        self.last = now
        elastic = self.indenter.energy() + self.slab.energy()
        energies = self.work, self.contact.dissipated_energy(), elastic
        t, dt = self.stepper.t, self.stepper.last_dt
        self.rows.append(Row(t, dt, now[2] / self.h, *now[:2], *energies))
        self.output.write(t, qs.step_row(self.stepper) | self.rows[-1]._asdict())

    def close(self):
        """Close the files."""
        self.output.close()
