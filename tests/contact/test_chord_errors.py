"""Pressures between facets of curved surfaces are right, or there is a warning."""

import numpy as np
import pytest
from contact.test_warnings import warned
from curved_scenes import ShrinkFit
from scenes import WORLD


def error(fit, reference):
    """Root mean square difference of the slave's pressure, over its mean in the reference."""
    area = fit.contact.slave.node_area
    got, right = (
        scene.contact.slave.node_values(scene.contact.pressure("slave"))
        for scene in (fit, reference)
    )
    sums = WORLD.allreduce(np.array([area @ (got - right) ** 2, area @ right, area.sum()]))
    return np.sqrt(sums[0] * sums[2]) / sums[1]


def solved(texts=None, **options):
    """A shrink fit that has been solved for, and what it has warned of."""
    fit = ShrinkFit(**options)
    found = warned(fit.problem().solve)
    if texts is not None:
        texts += found
    return fit


@pytest.mark.parametrize(
    "misfit, options, is_wrong",
    [
        (0.01, {}, True),
        (0.01, {"enforcement": "penalty"}, True),
        (0.01, {"sliding": "finite"}, True),
    ]
    + [(misfit, {}, misfit < 0.4) for misfit in (0.1, 0.8)],
)
def test_pressures(misfit, options, is_wrong):
    """Between facets pressures are wrong by more than a tenth, with a warning, or right without."""
    texts, n = [], ((48, 3), (66, 3))
    fit = solved(texts, n=n, misfit=misfit, **options)
    reference = solved(n=n, misfit=misfit, degrees=("elevated", 1))
    assert (error(fit, reference) > 0.1) == is_wrong
    assert any("pressures are wrong" in text for text in texts) == is_wrong, texts
