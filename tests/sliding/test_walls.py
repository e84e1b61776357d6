"""A block on a wider one in 3D, the walls of both named, in steps, with friction."""

import numpy as np
import pytest
from following import WORLD, Body, but_for, problem_of
from scenes import box, plane

import qsdolfinx as qs

#: Press, press and drag: along x and z.
WAYS = ((0.0, -0.02), (0.0, -0.05), (0.1, -0.05))


@pytest.mark.parametrize("shift", (0.0, 0.02, 0.07))
def test_lines_of_meshes_that_nearly_coincide(shift):
    """Points between them move far for little, and friction of the step before is smooth there.

    Newton went on for 50 iterations where points had what the closest one of before had, and where
    lines that coincide but for rounding crossed.
    """
    forces = []
    for sliding in ("small", "finite"):
        low = Body(box(WORLD, (8, 8, 3), "hexahedron", (0, 0, -0.5), (2, 2, 0)), stiffness=1e3)
        upper = (0.5 + shift, 0.5, 0), (1.5 + shift, 1.5, 1)
        high = Body(box(WORLD, (4, 4, 4), "hexahedron", *upper), stiffness=1e3)
        below, above = plane(low.mesh, 2, -0.5), plane(high.mesh, 2, 1.0)
        low.clamp(below)
        top = high.clamp(above)
        surfaces = but_for(high, above), but_for(low, below)
        contact = qs.Contact(*surfaces, friction=qs.Coulomb(0.3), sliding=sliding)
        problem = problem_of([low, high], [contact])
        for x, z in WAYS:
            top.value[[0, 2]] = x, z
            problem.solve()
            assert problem.num_iterations <= 14
        forces.append(contact.force("slave"))
    assert forces[1][0] / forces[1][2] == pytest.approx(-0.3, abs=0.02)
    np.testing.assert_allclose(forces[1], forces[0], atol=0.05 * forces[0][2])
