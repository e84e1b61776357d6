"""Stacked blocks whose corners overlap by less than a facet, pressed together in steps."""

import numpy as np
import pytest
from overlapping_corners import Corners

PENALTY = {"enforcement": "penalty", "penalty": 50.0}  # automatic ones depend on named facets
VARIANTS = {
    "nodal": {"quadrature": "nodal", "enforcement": "penalty", "penalty": 300.0},
    "nodes": PENALTY | {"constraints": "nodes"},
    "points": PENALTY,
    "augmented": {"penalty": 50.0},
}


@pytest.mark.parametrize("width", (0.01, 0.03, 0.1))
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("gdim", (2, 3))
def test_faces_beside_corners_carry_nothing(gdim, variant, width):
    """Forces grow evenly across touching faces, whether faces beside them are named or not."""
    n = (6, 7) if gdim == 2 else (4, 4)
    found = []
    for sides in (True, False):
        scene = Corners(width, gdim=gdim, sides=sides, n=n, **VARIANTS[variant])
        found.append(scene.press(3))
        across, along, _ = found[-1].T
        assert np.all(across < 0.04 * along)
        np.testing.assert_allclose(along / along[0], [1, 2, 3], rtol=0.25)
    (_, along, depth), (_, expected, least) = (np.transpose(values) for values in found)
    np.testing.assert_allclose(along, expected, rtol=0.05)
    assert np.all(depth < 1.5 * least + 5e-4)


@pytest.mark.parametrize("sides", (True, False))
def test_that_follow(sides):
    """In finite sliding vertices of pressed faces have no constraint besides those of the faces."""
    found = Corners(0.1, sides=sides, sliding="finite", **VARIANTS["augmented"]).press(3)
    assert len(found) == 3  # no cut-back
    np.testing.assert_allclose(found[:, 1] / found[0, 1], [1, 2, 3], rtol=0.05)


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_solve(variant):
    """Blocks that overlap by 0.004 initially have nearly the force of blocks that just touch."""
    forces = []
    for depth in (0.0, 0.004):
        scene = Corners(0.1, depth, **VARIANTS[variant])
        problem = scene.problem()
        scene.pressed.value[:] = -(0.008 - depth) * scene.axis
        problem.solve()
        forces.append(scene.contact.force("slave"))
        problem.destroy()
    assert abs(forces[1][0]) < 0.01 * forces[1][1]
    np.testing.assert_allclose(forces[1][1], forces[0][1], rtol=0.1)
