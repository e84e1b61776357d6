"""Means of multipliers over the neighbours of a node."""

import pytest
from following import Body
from scenes import WORLD, box, gathered, largest

from qsdolfinx.gap.neighbours import DECAY, NeighbourMeans
from qsdolfinx.surface.patches import patches_of_nodes


@pytest.mark.parallel
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron", "hexahedron"))
def test_means(cell):
    """Means of constants are these, and of linear functions inside a surface, too, on all ranks."""
    gdim = 2 if cell == "quadrilateral" else 3
    msh = box(WORLD, [5] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
    surface = Body(msh).side(gdim - 1, 1.0)
    means, patches = NeighbourMeans(surface), patches_of_nodes(surface)
    assert largest(means.of(1.0 * patches) - (1 - DECAY) * patches) < 1e-14
    x = surface.node_x[:, 0]
    inside = (x > 0.01) & (x < 0.99)
    if gdim == 3:
        y = surface.node_x[:, 1]
        inside &= (y > 0.01) & (y < 0.99)
    found = means.of(x[:, None] * patches)[:, 0]
    assert largest((found - (1 - DECAY) * x)[inside]) < 1e-14
    assert len(gathered(WORLD, x[inside])) == 4 ** (gdim - 1)
