"""Attempts at a step that fail after contact was updated at its end leave no trace."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, drag_top, elastic, elevated, plane, raises_everywhere
from step_scenes import SPEED, Upset, refuse, same

from dolfinx import fem

import qsdolfinx as qs

DT, TILT = 0.04, 0.5


class Tilting(Upset):
    """A block on an elastic die below a plane that moves down and rotates; some solves fail.

    Args:
        fails: Function from the number of a call of the solver, from 0 on, to whether it fails.
    """

    def __init__(self, fails, num_pairings, **options):
        self.fails, self.calls, self.starts = fails, 0, []
        options = {"dt": DT, "growth": 1.0, "num_pairings": num_pairings} | options
        super().__init__(die=True, drive=self.turn, solve=self.tried, **options)

    def turn(self, t, dt):
        self.starts.append((dt, [*self.state(), self.tool.rotation.copy()]))
        self.tool.displacement = [0.0, -SPEED * dt]
        self.tool.rotation = TILT * dt

    def tried(self, step):
        self.problem.solve()
        self.calls += 1
        if self.fails(self.calls - 1):
            refuse(1.0)


@pytest.mark.parametrize("num_pairings", (1, 3))
def test_next_attempt_starts_where_the_first_did(num_pairings):
    """If the solve for the end of a step fails, tools that have moved there are moved back."""
    first_step = num_pairings + 1  # with theta > 0 it is done twice
    failing = {first_step + num_pairings - 1, first_step + 2 * num_pairings - 1}
    case = Tilting(failing.__contains__, num_pairings)
    case.stepper.step()
    position = case.tool.position
    case.starts.clear()
    case.stepper.step()
    sizes, states = zip(*case.starts, strict=True)
    assert case.stepper.num_cutbacks == 2 and sizes == (DT, DT / 2, DT / 4)
    assert same(states[0], states[1]) and same(states[0], states[2])
    angle = TILT * (DT + DT / 4)
    turned = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    np.testing.assert_allclose(case.tool.position[:, :2], turned, atol=1e-14)
    np.testing.assert_allclose(case.tool.center, [0.0, 1 - SPEED * 1.25 * DT], atol=1e-14)
    assert not np.allclose(position, case.tool.position)
    reference = Tilting(lambda call: False, num_pairings)
    reference.stepper.step()
    reference.stepper.dt = DT / 4
    reference.stepper.step()
    np.testing.assert_allclose(case.forces(), reference.forces(), rtol=1e-9, atol=1e-9)


def shown(contact):
    """All values that a contact returns between two steps."""
    surfaces = [s for s in (contact.slave, contact.master) if isinstance(s, qs.Surface)]
    vecs = [vec.array_r.copy() for vec in contact.model.offset if vec is not None]
    numbers = [contact.dt, contact.settings.search_radius, contact.penalty, contact.penetration()]
    return [
        np.array(
            [
                *numbers,
                *contact.model.kinematics.scale,
                *contact.force("slave"),
                *contact.moment("slave"),
            ]
        ),
        np.nan_to_num(contact.gap()),
        np.nan_to_num(contact.weighted_gap()),
        contact.multiplier(),
        *(a.copy() for s in surfaces for a in (s.node_x, s.node_area)),
        *vecs,
    ]


@pytest.mark.parametrize("pairing", (1, 2))
def test_step_that_fails_for_good(pairing):
    """If all attempts at a step fail, at the first or last update of contact, nothing changes."""
    case = Tilting(lambda call: call > 2 and (pairing == 1 or call % 2 == 0), 2, dt_min=DT / 3)
    case.stepper.step()

    def everything():
        out = [*case.state(), case.tool.rotation.copy()]
        return out + [a for contact in case.contacts for a in shown(contact)]

    before = everything()
    raises_everywhere(WORLD, qs.StepError, "dt_min", case.stepper.step)
    assert case.stepper.num_cutbacks == 2 and case.calls == 3 + 2 * pairing
    assert same(before, everything())


def test_interrupted_at_the_end_of_a_step():
    """Any other error after the tool has moved to the end of the step also restores the state."""

    def fails(call):
        if call == 4:  # the second call of the second step
            raise KeyError("stop")

    case = Tilting(fails, 2)
    case.stepper.step()
    before, position = case.state(), case.tool.position
    with pytest.raises(KeyError):
        case.stepper.step()
    assert case.calls == 5 and same(before, case.state())
    np.testing.assert_array_equal(case.tool.position, position)


def test_first_attempt_of_all():
    """Values measured in a failed first attempt, such as γ, are measured again.

    Matrices of linear bodies are kept.
    """
    found = []
    for fails in (False, True):
        options = {"enforcement": "penalty", "friction": qs.Coulomb(0.3)}
        pair = Pair("quadrilateral", wave=0.05, contact_options=options)
        problem, calls = pair.problem(), []

        def solve(step, problem=problem, calls=calls, fails=fails):
            problem.solve()
            calls.append(step)
            if fails and len(calls) == 1:
                refuse(1.0)

        stepper = qs.TimeStepper(problem, 1.0 if fails else 0.5, lambda t, dt: None, solve=solve)
        stepper.step(0.5 if not fails else 1.0)
        assert stepper.t == 0.5 and stepper.num_cutbacks == fails
        penalty = pair.contact.model.penalty
        assert penalty.is_measured and penalty.of_points is not None
        found.append((penalty.of_points, *(u.x.array.copy() for u in pair.u)))
    for without, after in zip(*found, strict=True):
        np.testing.assert_allclose(after, without, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_forces_after_a_first_step_that_fails(enforcement):
    """After a failed first step contact shows the same forces as before.

    This holds although the constraints were different in the attempt.
    """
    options = {"enforcement": enforcement, "friction": qs.Coulomb(0.3)}
    pair = Pair("quadrilateral", contact_options=options)
    drag_top(pair, 0.4)
    problem = pair.problem()

    def solve(step):
        problem.solve()
        refuse(1.0)

    stepper = qs.TimeStepper(problem, 1.0, lambda t, dt: None, solve=solve, dt_min=0.6)
    before = pair.contact.force("slave")
    raises_everywhere(WORLD, qs.StepError, "dt_min", stepper.step)
    np.testing.assert_array_equal(pair.contact.force("slave"), before)


def test_facets_that_bend_too_far():
    """Facets of degree 2 that turn by more than 60° end the run as any impossible step does."""
    msh = elevated(box(WORLD, (1, 2), "quadrilateral", [-0.5, 0.0], [0.5, 1.0]))
    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u, bend = fem.Function(V), fem.Function(V)
    facets = plane(msh, 1, 0.0)
    held = fem.locate_dofs_topological(V, 1, facets)
    top = clamp(V, plane(msh, 1, 1.0))
    tool = qs.RigidSurface.plane(WORLD, [0.0, -5.0], [0.0, 1.0])
    options = {"search_radius": 10.0, "penalty": 1.0, "sliding": "small"}
    contact = qs.Contact(qs.Surface(V, facets=facets), tool, **options)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[top, fem.dirichletbc(bend, held)]])

    def drive(t, dt):
        bend.interpolate(lambda x: np.array([0 * x[0], 2.0 * t * (x[0] ** 2 - 0.25)]))

    stepper = qs.TimeStepper(problem, 0.25, drive, dt_min=0.1)
    with pytest.raises(qs.StepError, match="more curved than an arc of 60°"):
        for _ in stepper.run(3.0):
            pass
    assert 0 < stepper.t < 3.0
