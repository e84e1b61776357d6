"""Friction laws at one constraint: closed forms, derivatives in stick, slip and at the limit."""

import numpy as np
import pytest

import qsdolfinx as qs
from qsdolfinx.friction.laws import Rows

LAWS = {
    "coulomb": qs.Coulomb(0.3),
    "tresca": qs.Tresca(0.7),
    "coulomb-tresca": qs.CoulombTresca(0.3, 0.5, 2.0),
    "norton": qs.Norton(0.4, 2.0, 0.3),
    "norton-linear": qs.Norton(0.4, 2.0, 1.0),
    "norton-v0": qs.Norton(0.4, 2.0, 0.3, v0=0.5),
    "sticking": qs.Sticking(),
}


def rows_of(law, slip, traction, pressure, penalty=10.0, cover=1.0):
    """Make constraints across a random normal; slip and traction have two components there."""
    n = len(slip)
    normal = np.random.default_rng(1).normal(size=3)
    basis = np.linalg.svd(normal[None])[2][1:]  # two tangents
    projector = np.broadcast_to(basis.T @ basis, (n, 3, 3))
    return Rows(
        np.asarray(slip) @ basis,
        np.asarray(traction) @ basis,
        np.asarray(pressure, dtype=float),
        np.asarray(pressure) > 0,
        np.zeros(n, dtype=bool),
        np.full(n, penalty),
        projector,
        np.full(n, cover),
        0.5,
        2e-4,
        {name: np.full(n, value) for name, value in law.parameters.items()},
        np.ones(n),
        np.zeros(n),
    ), basis


def random_rows(law, n=200, size=0.3):
    rng = np.random.default_rng(7)
    pressure = np.maximum(rng.normal(size=n) + 1.5, 0)
    return rows_of(law, size * rng.normal(size=(n, 2)), rng.normal(size=(n, 2)), pressure)


def derivatives(law, rows, basis, step, side=0):
    """Return central or one-sided differences of τ: to slip (rows, 3, 2), pressure (rows, 3)."""

    def traction(**changes):
        return law.respond(rows._replace(**changes)).traction

    low, high = (0.0, step) if side else (-step, step)
    to_slip = [
        (traction(slip=rows.slip + high * t) - traction(slip=rows.slip + low * t)) / (high - low)
        for t in basis
    ]
    up = np.where(rows.closed, step, 0.0)
    to_pressure = traction(pressure=rows.pressure + up) - traction(pressure=rows.pressure - up)
    return np.stack(to_slip, axis=-1), to_pressure / (2 * step)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_derivatives(law):
    """Derivatives agree with differences in open, sticking and slipping constraints."""
    rows, basis = random_rows(law)
    response = law.respond(rows)
    to_slip, to_pressure = derivatives(law, rows, basis, 1e-7)
    np.testing.assert_allclose(response.stiffness @ basis.T, to_slip, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(response.coupling, to_pressure, rtol=1e-5, atol=1e-6)
    normal = np.cross(*basis)
    assert np.abs(response.traction @ normal).max() < 1e-14
    assert np.abs(response.stiffness @ normal).max() < 1e-14
    assert not response.traction[~rows.closed].any()
    assert not response.slipping[~rows.closed].any()
    assert response.slipping.any() or isinstance(law, qs.Sticking)
    if law.symmetric:
        assert not response.coupling.any()


@pytest.mark.parametrize("name", ("coulomb", "tresca", "coulomb-tresca"))
def test_switch(name):
    """At the limit the tangent is the one-sided derivative: stick inside, slip just outside."""
    law = LAWS[name]
    pressure = {"coulomb": 2.0, "tresca": 1.0, "coulomb-tresca": 1.2}[name]
    limit = law.limit(rows_of(law, [[0, 0]], [[0, 0]], [pressure])[0])[0][0]
    for angle in np.linspace(0, 6, 7):
        direction = np.array([np.cos(angle), np.sin(angle)])
        for factor, inward in ((1 - 1e-9, True), (1 + 1e-9, False)):
            rows, basis = rows_of(law, [[0, 0]], [factor * limit * direction], [pressure])
            response = law.respond(rows)
            assert response.slipping[0] != inward
            way = (-1 if inward else 1) * direction @ basis
            found = law.respond(rows._replace(slip=rows.slip + 1e-6 * way)).traction
            change = (found - response.traction)[0] / 1e-6
            expected = response.stiffness[0] @ way
            np.testing.assert_allclose(change, expected, atol=1e-4 * rows.penalty[0])


@pytest.mark.parametrize("name", ("coulomb", "tresca", "coulomb-tresca", "sticking"))
def test_return_mapping(name):
    """τ is the point of the disc |τ| ≤ κ that is closest to the trial; slip is along τ."""
    law = LAWS[name]
    rows, _ = random_rows(law)
    response = law.respond(rows)
    limit, _ = law.limit(rows)
    size = np.linalg.norm(response.traction, axis=1)
    trial = rows.traction + rows.penalty[:, None] * rows.slip
    closed, slips = rows.closed, response.slipping
    assert np.all(size <= limit * (1 + 1e-12))
    np.testing.assert_allclose(response.traction[closed & ~slips], trial[closed & ~slips])
    np.testing.assert_allclose(size[slips], limit[slips])
    across = np.cross(response.traction, response.dissipative)
    assert np.abs(across[closed]).max() < 1e-12
    work = np.sum(response.traction * response.dissipative, axis=1)
    assert np.all(work >= 0) and np.all(work[slips] > 0) and not np.any(work[closed & ~slips])


def test_made_to_stick():
    """Constraints without a limit have the trial multiplier and the penalty as stiffness."""
    law = LAWS["coulomb"]
    rows, _ = random_rows(law)
    response = law.respond(rows._replace(unlimited=rows.closed))
    trial = rows.traction + rows.penalty[:, None] * rows.slip
    np.testing.assert_allclose(response.traction[rows.closed], trial[rows.closed])
    stiffness = rows.penalty[:, None, None] * rows.projector
    np.testing.assert_allclose(response.stiffness[rows.closed], stiffness[rows.closed])
    assert not response.slipping.any() and not response.coupling.any()


@pytest.mark.parametrize("name", ("norton", "norton-linear", "norton-v0"))
def test_norton(name):
    """τ = α K |Δv|^(q-1) Δv of the mean slip rate well above v0; τ is linear well below v0."""
    law = LAWS[name]
    v0 = 2e-4 if law.v0 is None else law.v0
    for cover in (1.0, 0.25):
        for factor in (1e-3, 1e3):
            rate = factor * v0
            rows, basis = rows_of(law, [[0.5 * cover * rate, 0]], [[9.0, 9.0]], [1.0], cover=cover)
            response = law.respond(rows)
            expected = 0.8 * (rate**law.q if factor > 1 else rate * v0 ** (law.q - 1))
            np.testing.assert_allclose(
                response.traction[0] @ basis.T, [expected, 0], rtol=1e-5, atol=1e-12
            )
            assert response.slipping[0] == (factor > 1)
