"""Hard meshes, projections with two answers, sliding and frames."""

from mpi4py import MPI

import numpy as np
import pytest
from hard import geometry, motion, traps
from hard.scenes import Variant
from scenes import WORLD, vector_space

from dolfinx import mesh

import qsdolfinx as qs

KINDS = (
    Variant("quasi-symmetric", "overlay", "penalty"),
    Variant("quasi-symmetric", "nodal", "penalty"),
    Variant("master-slave", "overlay", "augmented-lagrangian"),
)


def cases(module, kinds, leave_out=()):
    """Parameters of a test: every case of the kinds, but for those with a word in their label."""
    return [
        pytest.param(case, id=f"{case.label}, {kind.formulation}, {kind.quadrature}")
        for kind in kinds
        for case in module.checks(kind)
        if not any(word in case.label for word in leave_out)
    ]


def holds(case):
    error, _ = case.run()
    errors = WORLD.allgather(error)
    assert max(errors) <= case.allowed


@pytest.mark.parametrize("case", cases(geometry, KINDS, ["3D", "e-12", "e-10", "hexahedron"]))
def test_meshes(case):
    holds(case)


@pytest.mark.parametrize("case", cases(traps, [Variant("quasi-symmetric", "nodal", "penalty")]))
def test_projections(case):
    holds(case)


@pytest.mark.parametrize("case", cases(motion, KINDS[:2], ["sliding", "triangle", "tetra"]))
def test_motion(case):
    holds(case)


def test_sliding_over_facets(monkeypatch):
    monkeypatch.setattr(motion, "FACETS", 8)
    error, _ = motion.slide(KINDS[0])
    assert max(WORLD.allgather(error)) < 1e-6


def test_quadrilaterals_that_fold_in_projection():
    """The sides of a warped block, seen from one beside it: what folds is left out.

    Once the map to its plane was inverted nevertheless: weights were negative and forces were out
    of balance.
    """
    faults = []
    for seed in range(12):
        surfaces = []
        for low in (0.0, 1.02):
            msh = mesh.create_box(
                WORLD, [[0, 0, low], [1, 1, low + 1]], [2, 2, 1], mesh.CellType.hexahedron
            )
            msh.topology.create_connectivity(2, 3)
            facets = mesh.exterior_facet_indices(msh.topology)
            x = msh.geometry.x
            waves = np.random.default_rng([seed, int(low)]).normal(size=(3, 3)) * 9
            x += 0.05 * np.sin(x @ waves)
            surfaces.append(qs.Surface(vector_space(msh), facets=facets))
        contact = qs.Contact(
            *surfaces, "master-slave", penalty=1.0, quadrature="overlay", search_radius=1.0
        )
        p = contact.pairing
        u = [s.create_vec() for s in surfaces]
        u[1].array[2::3] = 0.1  # the upper body's surface is the master, and is moved away
        u[0].array[2::3] = 0.3
        contact.evaluate(*u)
        forces = contact.force("slave"), contact.force("master")
        ones = [np.abs(s.shape_values.sum(axis=1) - 1) for s in (p.slave, p.master)]
        faults.append(max(e.max(initial=0.0) for e in ones))
        faults.append(-p.weight.min(initial=0.0))
        faults.append(np.abs(forces[0] + forces[1]).max() / np.abs(forces[0]).max())
    assert WORLD.allreduce(max(faults), op=MPI.MAX) < 1e-9
