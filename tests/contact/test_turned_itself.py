"""Self-contact of a body that is turned: which facets are slaves turns with the body."""

import numpy as np
import pytest
from following import Body, problem_of, rotation
from scenes import WORLD, box

import qsdolfinx as qs


def hairpin(angle, sliding):
    """Force, in axes of the body, and energy of a hairpin of unequal legs that is closed."""
    msh, R = box(WORLD, (36, 2), "quadrilateral", [0, 0], [1, 1]), rotation(angle)
    x = msh.geometry.x
    s, t = 2 * x[:, 0] - 1, 0.8 + 0.2 * x[:, 1]
    leg = np.maximum(np.abs(s) - 0.4, 0) * np.where(s > 0, 4, 5)
    bend = np.pi / 2 * np.clip(s / 0.4, -1, 1)
    x[:, 0], x[:, 1] = leg - t * np.cos(bend), t * np.sin(bend)
    body = Body(msh)
    ends = [body.boundary(lambda x, y=y: np.isclose(x[1], y) & (x[0] > 1.4)) for y in (1, -1)]
    moved = body.clamp(ends[0])
    body.clamp(ends[1])
    x[:, :2] = x[:, :2] @ R.T
    surface = body.surface(body.boundary(lambda x: np.full(x.shape[1], True)))
    contact = qs.Contact(
        surface, surface, search_radius=1.7, enforcement="penalty", penalty=1e2, sliding=sliding
    )
    problem = problem_of([body], [contact], solver="direct")
    for down in (0.8, 1.4, 1.58, 1.62):
        moved.value[:] = R @ [0.0, -down]
        problem.solve()
    return np.append(contact.force("slave") @ R, contact.stored_energy())


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_turned(sliding):
    straight = hairpin(0.0, sliding)
    assert np.abs(straight[1]) > 0.1
    for angle in (0.7, 2.0, 3.0, 4.5):
        turned = hairpin(angle, sliding)
        np.testing.assert_allclose(turned, straight, rtol=0, atol=1e-8 * np.abs(straight).max())
