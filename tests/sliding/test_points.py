"""Constraints at points of contact that follows the bodies."""

import numpy as np
import pytest
from friction.test_friction import quadratic_space
from scenes import Pair, vector_space
from system.test_equations import away, equations_of, errors

import qsdolfinx as qs

FINITE = {"sliding": "finite", "constraints": "points"}


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("space", (vector_space, quadratic_space), ids=("P1", "P2"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_derivative(cell, space, formulation):
    """Of the whole residual, areas held: at kinks, open ends and warped facets."""
    pair = Pair(cell, formulation=formulation, space=space, contact_options=FINITE, wave=0.02)
    _, equations = equations_of(pair)
    z, scale = away(equations)
    for values in equations.multipliers(z):  # all points are closed: none is where λ has a kink
        values.normal[:] += 5.0
    assert all(e.active[: -1].mean() > 0.5 for e in equations.evaluate(z).passes)
    assert errors(equations, z, scale) < 1e-7
