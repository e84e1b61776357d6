"""Contact with finite sliding gives the same result on any number of ranks."""

from mpi4py import MPI

import numpy as np
import pytest
from following import Boxes
from scenes import WORLD, largest

import qsdolfinx as qs

KINDS = {
    "quasi-symmetric": {},
    "master-slave": {"formulation": "master-slave", "enforcement": "penalty"},
    "double-pass": {"formulation": "double-pass"},
    "friction": {"friction": qs.Coulomb(0.3), "enforcement": "penalty"},
    "second-degree": {"degree": 2},
    "friction, multipliers": {"friction": qs.Coulomb(0.3)},
}


def results(comm, cell, degree=1, **options):
    """Return forces, energies and multiplier extremes after a press and a slide by two facets."""
    across = () if cell in ("triangle", "quadrilateral") else (1.0,)
    n = [2] * len(across)
    scene = Boxes(
        cell,
        ((10, *n, 2), (4, *n, 2)),
        ((2.0, *across, 0.5), (0.8, *across, 0.6)),
        start=0.53,
        degree=degree,
        comm=comm,
    )
    top = scene.clamp_far()
    contact = qs.Contact(scene.above, scene.below, sliding="finite", **options)
    problem = scene.problem(contact, solver="direct")
    out = []
    for move in ((0.0, -0.02), (0.2, -0.02), (0.4, -0.03)):
        top.value[0], top.value[-1] = move
        problem.solve()
        pressure = contact.multiplier()
        out += [
            *contact.force("slave"),
            *contact.force("master"),
            *np.atleast_1d(contact.moment("slave", np.zeros(scene.gdim))),
            contact.stored_energy(),
            contact.step_dissipation(),
            comm.allreduce(np.max(pressure, initial=0.0), op=MPI.MAX),
            comm.allreduce(np.sum(pressure)),
            comm.allreduce(np.sum(contact.weighted_gap())),
        ]
    return np.array(out, dtype=float)


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_same_on_all_ranks(cell, options):
    if "degree" in options and cell in ("tetrahedron", "hexahedron"):
        options = {}
    alone, together = (results(comm, cell, **options) for comm in (MPI.COMM_SELF, WORLD))
    assert largest(together - alone) < 1e-9 * np.abs(alone).max()
