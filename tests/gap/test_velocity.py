"""Velocity-based bodies: u = v Δt, (2), contact (3) at the end of the step."""

import numpy as np
import pytest
from scenes import LAWS, WORLD, Pair, clamp, largest, plane, raises_everywhere
from tangents import direction, tangent_errors

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import terms
from qsdolfinx.contact.motion import set_offset

DT = 0.3
KINDS = {
    "both": ("velocity", "velocity"),
    "slave": ("velocity", "displacement"),
    "master": ("displacement", "velocity"),
}


def scene(unknown, law=qs.Unilateral, formulation="quasi-symmetric", **options):
    """Make the elastic blocks with v = u/Δt as unknown of some bodies; u is the same."""
    pair = Pair("triangle", formulation, law(), n=(9, 7), wave=0.03)
    given = {"unknown": unknown, "dt": DT} | options
    pair.contact = qs.Contact(
        pair.slave, pair.master, formulation=formulation, law=law(), penalty=30.0, **given
    )
    for i, kind in enumerate(unknown[::-1]):  # the master is the first body
        if kind == "velocity":
            u = pair.u[i]
            pair.F[i] = ufl.replace(pair.F[i], {u: DT * u})
            far = plane(pair.meshes[i], 1, -1.0 if i == 0 else 1.0)
            pair.bcs[i] = [clamp(pair.V[i], far, [0.0, 0.0 if i == 0 else -0.1 / DT])]
    return pair, [1.0 if kind == "displacement" else DT for kind in unknown[::-1]]


@pytest.mark.parametrize("options", ({}, {"quadrature": "overlay"}))
@pytest.mark.parametrize("formulation", ("quasi-symmetric", "double-pass"))
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS)
def test_same_displacements(kind, law, formulation, options):
    pair, scales = scene(KINDS[kind], law, formulation, **options)
    pair.problem().solve()
    other = Pair("triangle", formulation, law(), n=(9, 7), wave=0.03, contact_options=options)
    other.problem().solve()
    for u, v, scale in zip(other.u, pair.u, scales, strict=True):
        assert largest(scale * v.x.array - u.x.array) < 1e-10 * largest(u.x.array)
    forces = [
        [c.force(side) for side in ("slave", "master")] for c in (pair.contact, other.contact)
    ]
    assert np.allclose(*forces, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_finite_differences(kind):
    """The tangent has scaled columns; it is symmetric if both bodies are velocity-based."""
    pair, _ = scene(KINDS[kind])
    problem = pair.problem()
    problem.solve()
    x, d = problem.system.x.copy(), direction(problem, np.random.default_rng(3))
    errors = tangent_errors(problem, x, d, 1e-6)
    assert errors.difference < 1e-6
    assert (errors.asymmetry < 1e-12) == (kind == "both")


def test_offset():
    """A known displacement counts like the unknown, also on meshes that are moved by it."""
    pair, _ = scene(KINDS["both"])
    known = [fem.Function(V) for V in pair.V]
    for function, size in zip(known, (0.02, 0.05), strict=True):
        function.interpolate(lambda x, size=size: size * np.sin(3 * x[:2] + 1))
    problem = pair.problem()
    problem.set_up()
    set_offset(pair.contact.model, known[1], known[0])
    zeros = [b.create_vec() for b in problem.bodies]
    terms.evaluate(pair.contact.model, zeros[1], zeros[0])
    gaps = pair.contact.weighted_gap()
    set_offset(pair.contact.model, None, None)
    for vec, function in zip(zeros, known, strict=True):
        vec.array[:] = function.x.array[: len(vec.array_r)] / DT
    terms.evaluate(pair.contact.model, zeros[1], zeros[0])
    assert np.nanmax(np.abs(gaps), initial=0.0) < 1
    np.testing.assert_allclose(gaps, pair.contact.weighted_gap(), atol=1e-14)


def test_penalty_follows_dt():
    """The automatic ε, stress per length, is the one of the displacement-based form."""
    pair, _ = scene(KINDS["both"])
    velocity = qs.Contact(pair.slave, pair.master, unknown="velocity", dt=DT)
    pair.contact = velocity
    pair.problem().set_up()
    other = Pair("triangle", n=(9, 7), wave=0.03, penalty="auto")
    other.problem().set_up()
    assert np.isclose(velocity.penalty, other.contact.penalty, rtol=1e-12)


def test_steps_that_differ():
    pair = Pair("triangle")
    raises_everywhere(WORLD, ValueError, "dt", lambda: pair.contact.set_dt(1.0))
    contacts = [qs.Contact(pair.slave, pair.master, unknown="velocity", dt=dt) for dt in (1.0, 2.0)]
    raises_everywhere(
        WORLD, ValueError, "dt", lambda: qs.ContactProblem(pair.F, pair.u, contacts, pair.bcs)
    )
