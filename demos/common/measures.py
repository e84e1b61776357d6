"""Measure quantities over all ranks: contact results at nodes, and wall-clock time."""

import time

from mpi4py import MPI

import numpy as np


class Clock:
    """Wall-clock time since the object was made, of the slowest rank; both calls are collective."""

    def __init__(self, comm):
        comm.barrier()
        self.comm, self.start = comm, time.perf_counter()

    def seconds(self):
        """Return the seconds up to now."""
        return self.comm.allreduce(time.perf_counter() - self.start, op=MPI.MAX)


def columns(rows, *names):
    """Return attributes of many rows, one array per attribute."""
    return [np.array([getattr(row, name) for row in rows]) for name in names]


def mean_and_max(comm, values):
    """Return the mean and the largest value. Collective."""
    number, total = comm.allreduce(np.array([len(values), np.sum(values)]))
    return total / number, comm.allreduce(np.max(values, initial=0.0), op=MPI.MAX)


def relative_l2(surface, value, exact, where=slice(None)):
    """(Σ S_k (t_k − t(x_k))² / Σ S_k t(x_k)²)^½ over nodes of a surface. Collective.

    Args:
        surface: Surface; S_k are the areas of its nodes.
        value: Values t_k.
        exact: Exact values t(x_k).
        where: Selection of nodes.
    """
    local = [(surface.node_area * f**2)[where].sum() for f in (value - exact, exact)]
    squares = surface.comm.allreduce(np.array(local))
    return np.sqrt(squares[0] / squares[1])


def stick_and_slip(contact):
    """Return stick and slip fractions, and friction energies of the last step. Collective.

    Returns:
        "stick" and "slip" are fractions of the active contact area, "stick_energy" is the energy
        dissipated at active nodes whose whole area sticks (others may slip and separate within the
        step), and "least" is the smallest energy dissipated at any node.
    """
    areas, sticking, least = np.zeros(2), 0.0, 0.0
    for side in (
        ("slave", "master") if contact.settings.formulation == "double-pass" else ("slave",)
    ):
        area, energy = getattr(contact, side).node_area, contact.dissipation(side)
        closed, slips = contact.shares(side)
        areas += area @ (closed - slips), area @ slips
        sticks = contact.active(side) & (slips == 0) & ~contact.slipping(side)
        sticking += energy[sticks].sum()
        least = min(least, energy.min(initial=0.0))
    areas, sticking = contact.comm.allreduce(areas), contact.comm.allreduce(sticking)
    least = contact.comm.allreduce(least, op=MPI.MIN)
    shares = dict(zip(("stick", "slip"), areas / areas.sum(), strict=True))
    return shares | {"stick_energy": sticking, "least": least}


def stick_zone(contact):
    """Return half the length of the stick zone of the slave, in 2D, and its centre. Collective."""
    closed, slips = contact.shares()
    size, x = contact.slave.node_area * (closed - slips), contact.slave.node_x[:, 0]
    length, moment = contact.comm.allreduce(np.array([size.sum(), size @ x]))
    return length / 2, moment / max(length, 1e-300)
