"""Friction at points: their history beyond that of the nodes persists between steps."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, drag_top, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.friction.of_points import OfPoints, SmoothRest

MU, PRESS, DRAG = 0.3, 0.05, 0.004
ENFORCEMENTS = ("penalty", "augmented-lagrangian")


class Block:
    """Block between a clamped bottom and a wider block that presses and drags it; part slips."""

    def __init__(self, cell, enforcement, law, sliding=None):
        axis = 1 if cell == "triangle" else 2
        low, high = [-0.5, -0.5, 1.0][2 - axis :], [1.5, 1.5, 1.5][2 - axis :]
        meshes = (
            box(WORLD, [4] * axis + [3], cell, [0.0] * (axis + 1), [1.0] * (axis + 1)),
            box(WORLD, [7] * axis + [2], cell, low, high),
        )
        V = [vector_space(msh) for msh in meshes]
        self.u = [fem.Function(space) for space in V]
        surfaces = [
            qs.Surface(space, facets=plane(msh, axis, 1.0))
            for space, msh in zip(V, meshes, strict=True)
        ]
        self.contact = qs.Contact(
            *surfaces,
            quadrature="overlay",
            constraints="points",
            enforcement=enforcement,
            sliding=sliding,
            friction=law,
            dt=1.0 if law.needs_dt else None,
        )
        self.shift = fem.Constant(meshes[1], np.zeros(axis + 1))
        top = fem.locate_dofs_topological(V[1], axis, plane(meshes[1], axis, 1.5))
        bcs = [[clamp(V[0], plane(meshes[0], axis, 0.0))], [fem.dirichletbc(self.shift, top, V[1])]]
        F = [elastic(u) for u in self.u]
        problem = qs.ContactProblem(F, self.u, [self.contact], bcs)
        self.stepper = qs.TimeStepper(problem, 1.0, self.drive)

    def drive(self, t, dt):
        self.shift.value[0], self.shift.value[-1] = DRAG * max(t - 1.0, 0.0), -PRESS

    def state(self):
        return [*(u.x.array.copy() for u in self.u), self.contact.force("slave")]


@pytest.mark.parametrize(
    "cell, enforcement, law",
    (
        ("hexahedron", "penalty", qs.Tresca(0.01)),
        ("triangle", "augmented-lagrangian", qs.Norton(0.1, 0.3, 0.5)),
    ),
)
def test_restart(cell, enforcement, law, tmp_path_factory):
    """The third step is the same, whether or not a checkpoint is loaded before it."""
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("points")), root=0)
    case, again = (Block(cell, enforcement, law) for _ in range(2))
    for _ in range(3):
        case.stepper.step()
    slip = case.contact.model.slips[0]
    parts = WORLD.allreduce(np.array([slip.slipping.sum(), slip.state.closed.sum()]))
    assert 0 < parts[0] < parts[1] or law.needs_dt
    qs.save_run(case.stepper, f"{folder}/run")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", qs.ContactWarning)
        qs.load_run(again.stepper, f"{folder}/run")
    # Slip rates are zero at the start of a step.
    assert [("the friction of Norton" in str(w.message)) for w in caught] == [True] * law.needs_dt
    shown = [one.contact.force("slave") for one in (case, again)]
    assert (largest(shown[0] - shown[1]) < 1e-8 * largest(shown[0])) is not law.needs_dt
    for one in (case, again):
        one.stepper.step()
    for a, b in zip(case.state(), again.state(), strict=True):
        assert largest(a - b) < 1e-8 * largest(a)
    energies = [one.contact.dissipated_energy() for one in (case, again)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-6)


@pytest.mark.parametrize("enforcement", ENFORCEMENTS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
@pytest.mark.parametrize(("sliding", "creep"), (("small", 1e-2), ("finite", 1.5e-2)))
def test_where_nothing_moves(sliding, creep, cell, enforcement):
    """Without motion, updating the contact pairs and the areas changes nothing."""
    case = Block(cell, enforcement, qs.Coulomb(MU), sliding)
    for _ in range(3):
        case.stepper.step()
    case.stepper.drive = lambda t, dt: None
    case.stepper.step()  # contact detection and areas at the result of the last step
    before, energy = case.state(), case.contact.dissipated_energy()
    for _ in range(4):
        case.stepper.step()
    for a, b in zip(before, case.state(), strict=True):
        assert largest(a - b) < 2e-4 * largest(a)
    assert case.contact.dissipated_energy() - energy < creep * energy


@pytest.mark.parametrize("gdim", (2, 3))
def test_smooth_data_of_points(gdim):
    """A vector that is the same at all old points is the same at new ones between their facets."""
    rng = np.random.default_rng(2)
    keys, place = np.repeat([[3, 5], [4, 5]], 40, axis=0), rng.random((80, gdim))
    place /= place.sum(axis=1, keepdims=True)
    vector = np.arange(1.0, gdim + 1)
    old = OfPoints(keys, place, np.tile(vector, (80, 1)), np.tile(np.eye(gdim)[0], (80, 1)))
    new = np.array([[4, 5], [4, 6], [3, 5]])  # no old points between 4 and 6
    values = SmoothRest(old).at(new, place[:3])
    expected = np.array([1.0, 0.0, 1.0])[:, None] * vector
    np.testing.assert_allclose(values, expected, atol=1e-10)


@pytest.mark.parametrize("gdim", (2, 3))
def test_slopes_of_smooth_data(gdim):
    """The derivative of a smooth function by the position agrees with differences."""
    rng = np.random.default_rng(2)
    keys, place = np.repeat([[3, 5], [4, 5]], 40, axis=0), rng.random((80, gdim))
    place /= place.sum(axis=1, keepdims=True)
    old = OfPoints(keys, place, rng.random((80, gdim)), np.tile(np.eye(gdim)[0], (80, 1)))
    smooth, new = SmoothRest(old), np.array([[4, 5], [4, 6], [3, 5]])
    at, way, step = place[[40, 41, 0]], rng.random((3, gdim)) - 0.5, 1e-3
    values = {k: smooth.at(new, at + k * step * way) for k in (-2, -1, 1, 2)}
    difference = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * step)
    slopes = np.einsum("pk,pki->pi", way, smooth.slopes(new, at))
    np.testing.assert_allclose(slopes, difference, rtol=1e-8, atol=1e-10)


def dragged(enforcement, sliding, v0=None):
    """Force after blocks have been pressed and dragged in one step, and the slow slip rate."""
    pair = Pair("triangle", n=(5, 7), wave=0.02)
    law = qs.Norton(0.1, 0.3, 0.5, v0)
    pair.contact = contact = qs.Contact(
        pair.slave, pair.master, enforcement=enforcement, sliding=sliding, friction=law, dt=1.0
    )
    drag_top(pair, 0.3)
    pair.problem(solver="direct").solve()
    model = contact.model
    return contact.force("slave"), model.friction.slow(1.0, model.paired.facet_size)


@pytest.mark.parallel
@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("enforcement", ENFORCEMENTS)
def test_slow_rate_found_or_given(enforcement, sliding):
    """The solve is repeated with the slip rate that it finds, as if this had been known.

    With finite sliding, it begins at other contact quadrature points than it ended.
    """
    found, rate = dragged(enforcement, sliding)
    given, _ = dragged(enforcement, sliding, rate)
    assert abs(found[0]) > 0.05 * abs(found[1])
    assert largest(found - given) < 1e-9 * largest(given)
