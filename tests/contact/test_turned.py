"""Surfaces that turn in a solve with small sliding: a warning, and its remedies."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs


def tilted(comm):
    """A plane above the block, which turns about a point of it."""
    return qs.RigidSurface.plane(comm, [0.0, 0.0], [0.0, -1.0])


def square(comm):
    """A square above the block, which turns about its middle."""
    x = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]])
    return qs.RigidSurface.triangulated(comm, x, [[0, 1], [1, 2], [2, 3], [3, 0]], [0.0, 0.5])


def round_(comm):
    """A cylinder above the block, which turns in place."""
    return qs.RigidSurface.cylinder(comm, [0.0, 0.5], None, 0.5)


def block(make, **options):
    """Return tool, contact and problem of a block below the tool."""
    msh = box(WORLD, (16, 8), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
    V = vector_space(msh)
    u, tool = fem.Function(V), make(WORLD)
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool, **options)
    bcs = [clamp(V, plane(msh, 1, -1.0))]
    return tool, contact, qs.ContactProblem([elastic(u, 10.0)], [u], [contact], [bcs])


def forces(make, angle, steps=0, **options):
    """Press the tool, turn it in a solve or in steps; return force and texts of warnings."""
    tool, contact, problem = block(make, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if not steps:
            tool.displacement[-1] = -0.05
            problem.solve()
            tool.rotation = angle
            problem.solve()
        else:

            def drive(t, dt):
                tool.displacement = [0.0, -0.05 * dt if t < 1 + 1e-9 else 0.0]
                tool.rotation = 0.0 if t < 1 + 1e-9 else angle * dt

            stepper = qs.TimeStepper(problem, 1.0, drive)
            stepper.step()
            stepper.dt = 1 / steps
            for _ in stepper.run(2.0):
                pass
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    return contact.force("slave"), texts


@pytest.mark.parallel
@pytest.mark.parametrize(
    "make, angle, text",
    (
        (tilted, 0.2, "sliding: surfaces in contact have turned since contact detection"),
        (square, 0.3, "facets and has turned since contact detection"),
        (round_, 0.5, "facets and has turned since contact detection"),
    ),
)
def test_turned_in_a_solve(make, angle, text):
    """A solve with small sliding warns where forces are wrong since a tool turns; steps do not."""
    right, texts = forces(make, angle, sliding="finite")
    assert not [text for text in texts if "corners" not in text]
    wrong, texts = forces(make, angle, sliding="small")
    texts = [text for text in texts if "corners" not in text]
    assert len(texts) == 1 and text in texts[0] and 'sliding="finite"' in texts[0]
    assert np.linalg.norm(wrong - right) > 0.1 * np.linalg.norm(right)
    if make is not square:  # its corners need finer facets than these
        stepped, none = forces(make, angle, 2, sliding="small")
        assert not none
        assert np.linalg.norm(stepped - right) < 0.04 * np.linalg.norm(right)


@pytest.mark.parametrize("make", (tilted, square, round_))
def test_turned_a_little(make):
    """Small rotations are right with small sliding, and give no warning."""
    right, texts = forces(make, 0.02, sliding="finite")
    found, more = forces(make, 0.02, sliding="small")
    assert not texts and not more
    assert np.linalg.norm(found - right) < 0.05 * np.linalg.norm(right)
