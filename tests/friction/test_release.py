"""Energy of constraints that open in a step: it does not depend on how rounding names their state.

A step in which nothing moves leaves slipping constraints on their limit, where they count as
sticking: |τ̂| is μ λ but for rounding. The next step must dissipate what it would without that step.
"""

import numpy as np
import pytest
from scenes import WORLD, box, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs


def dissipated(path, law):
    """Energy of each step of a block on a rigid floor, whose top is moved along a path."""
    msh = box(WORLD, (6, 3), "triangle", [0.0, 0.0], [1.4, 1.0])
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    stress = qs.materials.linear_elastic(u, 1e3, 0.3)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
    bc = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0)), V)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, floor, friction=law)
    problem = qs.ContactProblem(F, u, contact, [bc])
    stepper = qs.TimeStepper(problem, 1.0, max_penetration=None)
    energies = [0.0]
    for place in path:
        top.value = place
        stepper.step()
        energies.append(contact.dissipated_energy())
    assert stepper.num_cutbacks == 0 and np.sum(contact.active()) == 0
    return np.diff(energies)


@pytest.mark.parametrize("law", (qs.Coulomb(0.3), qs.CoulombTresca(0.3, 0.5, 40.0)), ids=repr)
def test_rest_before_release(law):
    pressed, dragged, released = (0.0, -0.02), (0.02, -0.03), (0.03, 0.02)
    at_once = dissipated([pressed, dragged, released], law)
    rested = dissipated([pressed, dragged, dragged, released], law)
    assert at_once[-1] > 0.1 * at_once[1] > 0
    np.testing.assert_allclose(rested[2], 0.0, atol=1e-9 * at_once[1])
    np.testing.assert_allclose(rested[-1], at_once[-1], rtol=1e-6)
