"""Initial guess of Newton's method for loaded bodies that are supported by contact alone."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs


@pytest.mark.parametrize("dt", (None, 0.01))
@pytest.mark.parametrize("slope", (0.0, 0.1))
@pytest.mark.parametrize("gap", (0.0, 0.05, 0.3))
@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_rests_at_once(cell, gap, slope, dt):
    """A block that can move vertically falls on a plane: Newton's method needs one step.

    With Δt the block is viscous, and displacements are velocities times Δt.
    """
    gdim = 2 if cell == "quadrilateral" else 3
    axis = gdim - 1
    msh = box(WORLD, [4] * axis + [3], cell, [0.0] * gdim, [1.0] * gdim, "scattered")
    V, facets = vector_space(msh), plane(msh, axis, 0.0)
    held = [slide(V, i, plane(msh, i, 0.0)) for i in range(axis)]
    msh.geometry.x[:, axis] += slope * msh.geometry.x[:, 0] ** 2
    u, weight = fem.Function(V), np.zeros(gdim)
    weight[-1] = -0.2
    low = np.zeros(gdim)
    low[-1] = -gap
    tool = qs.RigidSurface.plane(WORLD, low, -weight)
    surface = qs.Surface(V, facets=facets)
    options = {"enforcement": "penalty", "constraints": "nodes"}
    if dt is not None:
        options |= {"unknown": "velocity", "dt": dt}
    contact = qs.Contact(surface, tool, penalty=1e3, search_radius=0.5, **options)
    form = elastic(u, 1.0 if dt is None else dt, force=fem.Constant(msh, weight))
    problem = qs.ContactProblem([form], [u], [contact], [held])
    problem.solve()
    nodes = WORLD.allreduce(len(surface.node_x))
    volume = WORLD.allreduce(fem.assemble_scalar(fem.form(fem.Constant(msh, 1.0) * ufl.dx)))
    np.testing.assert_allclose(contact.force("slave"), -weight * volume, atol=1e-9)
    assert problem.num_iterations <= 2
    assert problem.active_history[0] == [nodes]
