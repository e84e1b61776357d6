"""Bodies that just touch, to rounding, at the end of a step, with friction."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

GAP = 0.004


@pytest.mark.parametrize("rest", (0.0, 1e-16, 4e-16, -4e-16, -1e-13))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_nothing_is_left_to_solve(enforcement, rest):
    """Rounding opens and closes the gap, without pressure, and solves still converge."""
    shapes = ([0.0, -1.0], [4.0, 0.0], (20, 5), -1.0), ([0.3, GAP], [1.3, 1 + GAP], (4, 4), 1 + GAP)
    surfaces, us, forms, bcs = [], [], [], []
    for i, (low, high, n, held) in enumerate(shapes):
        msh = box(WORLD, n, "quadrilateral", low, high, "scattered")
        V = vector_space(msh)
        us.append(fem.Function(V))
        forms.append(elastic(us[-1], E=1e3))
        bcs.append([clamp(V, plane(msh, 1, held), [0.0, i * (rest - GAP)])])
        surfaces.append(qs.Surface(V, facets=plane(msh, 1, i * GAP)))
    contact = qs.Contact(
        surfaces[1],
        surfaces[0],
        quadrature="overlay",
        enforcement=enforcement,
        friction=qs.Coulomb(0.2),
    )
    problem = qs.ContactProblem(forms, us, [contact], bcs)
    problem.solve()
    assert problem.num_iterations < 30
    assert largest(contact.force("slave")) < 1e-9
    np.testing.assert_allclose(us[1].x.array.reshape(-1, 2)[:, 1], rest - GAP, atol=1e-12)
