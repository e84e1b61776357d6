"""Input that contact with finite sliding refuses, by the name of the argument."""

import numpy as np
import pytest
from following import Boxes
from scenes import WORLD, raises_everywhere

import qsdolfinx as qs


def scene():
    return Boxes("quadrilateral", ((4, 1), (3, 1)), ((1.2, 0.5), (1.0, 0.5)), start=0.1)


@pytest.mark.parametrize(
    "options",
    (
        {"sliding": "large"},
        {"quadrature": "nodal"},
        {"normals": "bisector"},
    ),
)
def test_refused(options):
    """Arguments that finite sliding refuses; for others see base/test_malformed.py."""
    bodies = scene()
    given = {"sliding": "finite"} | options
    make = lambda: qs.Contact(bodies.above, bodies.below, **given)  # noqa: E731
    raises_everywhere(WORLD, ValueError, "sliding", make)


@pytest.mark.parametrize("value", (np.nan, np.inf))
def test_unknowns_that_are_not_finite(value):
    """Unknowns that are not finite give an error on all ranks."""
    bodies = scene()
    bodies.clamp_far()
    contact = qs.Contact(bodies.above, bodies.below, sliding="finite")
    problem = bodies.problem(contact)
    bodies.upper.u.x.array[:] = value
    with pytest.raises((ValueError, qs.ConvergenceError)):
        problem.solve()
    bodies.upper.u.x.array[:] = 0.0
    problem.solve()
    assert problem.num_iterations <= 1


def test_tie_stays_a_tie():
    """Tied contact has no geometry to update: both kinds of sliding give the same result."""
    out = []
    for sliding in ("small", "finite"):
        bodies = scene()
        top = bodies.clamp_far()
        top.value[:] = 0.01, 0.02
        contact = qs.Contact(
            bodies.above, bodies.below, law=qs.Tied(), normals="facet", sliding=sliding
        )
        bodies.problem(contact).solve()
        out.append(contact.force("slave"))
    assert np.abs(out[0] - out[1]).max() < 1e-12 * np.abs(out[0]).max()
