"""Block with a closed slit, whose two sides have facets at the same places."""

import numpy as np
import pytest
from following import Body, create, problem_of, total

import qsdolfinx as qs


def slit_block(cell, n=4):
    """Return vertices and cells of [0, 2] × [-1, 1], with all nodes on y = 0, x < 1 duplicated."""
    y = np.concatenate([np.linspace(-1, 0, n + 1), np.linspace(0, 1, n + 1)])
    i, j = np.meshgrid(np.arange(2 * n + 1), np.arange(2 * n + 2), indexing="ij")
    twin = np.where((j == n + 1) & (i >= n), j - 1, j)
    used, number = np.unique(i * (2 * n + 2) + twin, return_inverse=True)
    number = number.reshape(i.shape)
    x = np.stack([used // (2 * n + 2) / n, y[used % (2 * n + 2)]], axis=1)
    rows = np.delete(np.arange(2 * n + 1), n)
    a, b = number[:-1][:, rows], number[1:][:, rows]
    c, d = number[:-1][:, rows + 1], number[1:][:, rows + 1]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    if cell == "quadrilateral":
        return x, quads
    return x, np.concatenate([quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]])


@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_pressed(cell, sliding):
    """A pressed slit has no effect, however the vertices of the facets are numbered."""
    body = Body(create(cell, *slit_block(cell)))
    surface = body.surface(body.boundary(lambda x: np.full(x.shape[1], True)))
    contact = qs.Contact(surface, surface, sliding=sliding)
    body.hold(1, 1, -1.0)
    body.hold(1, 1, 1.0, -0.1)
    body.hold(0, 0, 2.0)
    problem_of([body], [contact]).solve()
    rest = body.V.tabulate_dof_coordinates()[: body.num_owned // 2]
    u = body.places - rest[:, :2]
    assert np.allclose(u[:, 1], -0.05 * (1 + rest[:, 1]), atol=1e-6)
    # All slave facets are on one side.
    force = contact.force("slave")
    held = np.abs(rest[:, 1] - 1) < 1e-9
    pressed = total(body.internal_forces()[held])[1]
    assert 0.3 < abs(force[1] / pressed) < 0.51
