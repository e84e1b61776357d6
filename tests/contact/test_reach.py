"""Detection of surfaces that pass through each other beyond the search distance."""

import warnings

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, raises_everywhere, vector_space

from dolfinx import fem

import qsdolfinx as qs

GAP, RADIUS = 0.5, 0.1


def far_below(tool_moves, block_moves):
    """Make a problem in which a tool and a block far below it move along z."""
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0 + GAP], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # there are no contact pairs
        contact = qs.Contact(surface, tool, penalty=1.0, search_radius=RADIUS, sliding="small")
    bcs = [clamp(V, plane(msh, 1, 0.0), [0.0, block_moves])]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])
    tool.displacement = [0.0, tool_moves]
    return problem


def warned(tool_moves, block_moves):
    """Return whether a solve of the problem warns."""
    problem = far_below(tool_moves, block_moves)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        problem.solve()
    return any(issubclass(w.category, qs.ReachWarning) for w in found)


@pytest.mark.parametrize(
    "tool_moves, block_moves, expected",
    (
        (-0.49, 0.0, False),
        (-0.51, 0.0, True),
        (-3.0, 0.0, True),
        (0.51, 0.0, False),
        (0.0, 0.51, True),
        (0.0, 0.49, False),
        (0.0, -0.51, False),
        (-0.26, 0.25, True),
        (-0.25, 0.24, False),
        (0.2, 0.6, False),
        (-0.6, -0.25, False),
    ),
)
def test_what_has_passed_through_counts(tool_moves, block_moves, expected):
    """Passing through counts, not coming near: approach of one side less the other's retreat."""
    found = WORLD.allgather(warned(tool_moves, block_moves))
    assert found == [expected] * WORLD.size


@pytest.mark.parametrize("along, down, expected", ((5.0, 0.0, False), (5.0, -0.6, True)))
@pytest.mark.parametrize("rigid", (True, False))
def test_tangential_motion_is_no_approach(along, down, expected, rigid):
    """Tangential motion is no approach: an overhanging slave slides by many facets."""
    upper = box(WORLD, (12, 2), "quadrilateral", [-2.0, GAP], [1.0, 1.0 + GAP])
    V = vector_space(upper)
    u, bcs = [fem.Function(V)], [[clamp(V, plane(upper, 1, 1.0 + GAP), [along, down])]]
    slave = qs.Surface(V, facets=plane(upper, 1, GAP))
    if rigid:
        master = qs.RigidSurface.triangulated(
            WORLD, np.array([[12.0, 0.0], [4.0, 0.0], [-4.0, 0.0]]), [[0, 1], [1, 2]], [0.0, 0.0]
        )
    else:
        lower = box(WORLD, (20, 2), "quadrilateral", [-4.0, -1.0], [12.0, 0.0])
        W = vector_space(lower)
        u.append(fem.Function(W))
        bcs.append([clamp(W, plane(lower, 1, -1.0))])
        master = qs.Surface(W, facets=plane(lower, 1, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        contact = qs.Contact(slave, master, penalty=1.0, search_radius=RADIUS)
    problem = qs.ContactProblem([elastic(w) for w in u], u, [contact], bcs)
    found = bool(reach_warnings(problem.solve))
    assert WORLD.allgather(found) == [expected] * WORLD.size


def reach_warnings(call):
    """Return the reach warnings inside the call, with line and file."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        call()
    return [(w.filename, w.lineno) for w in found if issubclass(w.category, qs.ReachWarning)]


def test_points_to_the_line_of_the_user():
    """The warning points to the user's line of the solve or the step, once for each contact."""
    problem = far_below(-0.51, 0.0)
    stepper = qs.TimeStepper(far_below(-0.51, 0.0), 1.0, max_penetration=None)

    def steps():
        for _ in stepper.run(2.0):
            stepper.tools[0].displacement = [0.0, -0.11]

    for call, line in ((lambda: [problem.solve() for _ in range(2)], 0), (steps, 1)):
        first = call.__code__.co_firstlineno
        assert reach_warnings(call) == [(__file__, first + line)]
        assert reach_warnings(problem.solve) == []


def test_an_error_each_time():
    """A user who turns the warning into an error gets the error in every solve."""
    problem = far_below(-0.51, 0.0)
    for _ in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(qs.ReachWarning):
                problem.solve()


@pytest.mark.parametrize(
    "moves, expected", (((0.26, -0.26), True), ((0.24, -0.24), False), ((-0.3, 0.3), False))
)
def test_two_bodies(moves, expected):
    """Each body moves towards the other by less than the gap, and both together by more."""
    u, F, bcs, surfaces = [], [], [], []
    for low, move in zip((0.0, 1.0 + GAP), moves, strict=True):
        msh = box(WORLD, (3, 2), "quadrilateral", [0.0, low], [1.0, low + 1.0])
        V = vector_space(msh)
        u.append(fem.Function(V))
        F.append(elastic(u[-1]))
        far, near = (low, low + 1.0) if low == 0 else (low + 1.0, low)
        bcs.append([clamp(V, plane(msh, 1, far), [0.0, move])])
        surfaces.append(qs.Surface(V, facets=plane(msh, 1, near)))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        contact = qs.Contact(*surfaces[::-1], penalty=1.0, search_radius=RADIUS)
        qs.ContactProblem(F, u, [contact], bcs).solve()
    warned_here = any(issubclass(w.category, qs.ReachWarning) for w in found)
    assert WORLD.allgather(warned_here) == [expected] * WORLD.size
    assert np.isfinite(u[0].x.array).all()


def collapsing(t):
    """Make a problem whose conditions shrink the contact facets, to zero size at t = 1, and t."""
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, value = fem.Function(V), fem.Function(V)
    top = plane(msh, 1, 1.0)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0 + GAP], [0.0, -1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        contact = qs.Contact(qs.Surface(V, facets=top), tool, penalty=1.0, search_radius=RADIUS)
    dofs = fem.locate_dofs_topological(V, 1, top)
    bcs = [clamp(V, plane(msh, 1, 0.0)), fem.dirichletbc(value, dofs)]

    def set_to(t):
        value.interpolate(lambda x: np.stack([-t * x[0], 0 * x[1]]))

    set_to(t)
    return qs.ContactProblem([elastic(u)], [u], [contact], [bcs]), contact, set_to


def test_facets_without_area():
    """Facets without area have no distances: the solution stays, with a warning."""
    problem, contact, _ = collapsing(1.0)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        (u,) = problem.solve()
    texts = [str(w.message) for w in found if issubclass(w.category, qs.ContactWarning)]
    assert ["degenerate" in text for text in texts] == [True]
    assert np.isclose(WORLD.allreduce(-u.x.array.min(initial=0.0), op=MPI.MAX), 1.0)
    raises_everywhere(WORLD, ValueError, "degenerate", contact.gap)


def test_facets_without_area_in_a_step():
    """A smaller step may avoid facets without area."""
    problem, _, set_to = collapsing(0.0)
    drive = lambda t, dt: set_to(1.0 if dt > 0.3 else 0.9)  # noqa: E731
    stepper = qs.TimeStepper(problem, 1.0, drive, min_quality=1e-12)
    stepper.step()
    assert stepper.num_cutbacks > 0 and stepper.t <= 0.3
