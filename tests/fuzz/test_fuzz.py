"""Some of the random scenes of ``run.py``, and a test that its checks can fail."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
from fuzz import brute
from fuzz.bodies import make_contact, random_scene
from fuzz.checks import center_of, check_scene, paired_nodes
from fuzz.run import run
from fuzz.solve import check_solve
from scenes import all_facets

#: Scenes of seed 1 that have failed once: warped quadrilaterals that fold in projection, or nearly;
#: facets partly in front of others that are seen from the side; nodes that just touch; coincident
#: vertices of segments.
FOLDED = (6, 64, 113, 476, 672, 987, 1433, 2295, 3259, 3712, 7599, 8469)


@pytest.mark.parametrize(
    "check, scenes",
    [
        *((check_scene, range(first, first + 20)) for first in range(1000, 1060, 20)),
        pytest.param(check_scene, FOLDED, id="that failed once"),
        (check_solve, range(2000, 2012)),
        pytest.param(check_scene, range(3000, 5000), id="many", marks=pytest.mark.long),
        pytest.param(check_solve, range(3000, 3200), id="many solves", marks=pytest.mark.long),
    ],
)
def test_scenes(check, scenes):
    faults = []
    failed, _, _ = run(check, 1, scenes, faults.append)
    assert failed == 0, faults


def test_brute_force_finds_faults():
    """Points that are moved a little, removed or invented are not accepted as closest points."""
    counts = np.zeros(3, dtype=int)
    for index in range(12):
        scene = random_scene(3, index)
        options = {"quadrature": "nodal", "formulation": "master-slave"}
        scene = dataclasses.replace(scene, degree=1, options=scene.options | options)
        contact = make_contact(MPI.COMM_SELF, scene)
        ((slave, master, found, x),) = paired_nodes(contact)
        given = slave.node_x, slave.node_normal, all_facets(master), center_of(scene, 1)
        given, own = (*given, scene.options["search_radius"]), all_facets(slave)
        assert brute.nodal_faults(*given, found, x, own) == []
        away = x + 1e-3 * scene.size * brute.unit(x - slave.node_x + 1e-12 * scene.size)
        toward = x - 1e-3 * (x - slave.node_x)
        for i, (now, where) in enumerate(((found, away), (found, toward), (~found, x))):
            counts[i] += bool(brute.nodal_faults(*given, now, where, own))
    assert np.all(counts >= 3), counts
