"""Points that have passed through a thin part of the other surface, and left it again."""

import warnings

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box, vector_space

from dolfinx import mesh

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.passed import find_passed

THICK, GAP, RADIUS = 0.04, 0.05, 0.06


def boundary_of(msh):
    """Return all facets on the boundary of a mesh."""
    msh.topology.create_connectivity(msh.topology.dim - 1, msh.topology.dim)
    return mesh.exterior_facet_indices(msh.topology)


def boundary(gdim, cell):
    """Make the surface of a box that is [-0.5, 0.5] along each axis, thinner along the last one."""
    low, high = np.full(gdim, -0.5), np.full(gdim, 0.5)
    low[-1], high[-1] = -THICK / 2, THICK / 2
    msh = box(WORLD, (3,) * (gdim - 1) + (2,), cell, low, high, "scattered")
    return qs.Surface(vector_space(msh), facets=boundary_of(msh)), low, high


def clip(start, end, low, high):
    """Return where a straight path enters and leaves a box, and the axis along which it leaves."""
    way = end - start
    with np.errstate(divide="ignore"):
        a, b = (low - start) / way, (high - start) / way
    last = np.maximum(a, b)
    return np.minimum(a, b).max(), last.min(), int(np.argmin(last))


@pytest.mark.parametrize(
    "gdim, cell",
    ((2, "triangle"), (3, "tetrahedron"), (3, "hexahedron")),
)
@pytest.mark.parametrize("moves", (False, True))
def test_lengths_within_a_box(gdim, cell, moves):
    """Lengths of random paths through a box, which may move itself, are those of a clipped line.

    They count if the point looks the way that the face does through which it comes out.
    """
    surface, low, high = boundary(gdim, cell)
    rng = np.random.default_rng(3)
    shift = rng.uniform(-1, 1, gdim) if moves else np.zeros(gdim)
    start, end = rng.uniform(-0.6, 0.6, (2, 400, gdim))
    normal = rng.normal(size=(400, gdim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    mine = np.arange(400) % WORLD.size == WORLD.rank
    expected = np.zeros(400)
    for i in range(400):
        first, last, axis = clip(start[i], end[i], low, high)
        alike = np.sign((end - start)[i, axis]) * normal[i, axis]
        if first < last and 0 < last < 1 and alike > 0.5:
            expected[i] = (last - max(first, 0)) * np.linalg.norm(end[i] - start[i])
    assert np.count_nonzero(expected) > 50

    def padded(x):
        return np.pad(x, ((0, 0), (0, 3 - gdim)))[mine]

    facets = surface.cpp_object
    was = np.pad(shift, (0, 3 - gdim))
    lengths = _cpp.passed_lengths(
        facets, facets.facet_x - was, padded(start - shift), padded(end), padded(normal)
    )
    assert np.allclose(lengths, expected[mine], rtol=1e-9, atol=1e-12)


class OntoASheet:
    """A block that is pushed down by 0.2 on a thin part, through a small gap.

    Args:
        kind: ``"facets"`` of a closed rigid sheet, a deformable ``"body"`` that is held at its
            ends, two thin analytic ``"bars"``, or a ``"round"`` tool whose centre reaches the
            surface.
    """

    DOWN = 0.2

    def __init__(self, kind):
        n = (30, 5) if kind == "bars" else (10, 5)
        block = Body(box(WORLD, n, "quadrilateral", [0.0, 0.0], [1.0, 0.5]))
        top = block.clamp(block.boundary(lambda x: np.isclose(x[1], 0.5)))
        slave, bodies = block.side(1, 0.0), [block]
        if kind == "body":
            low, high = [-0.5, -GAP - THICK], [1.5, -GAP]
            sheet = Body(box(WORLD, (20, 2), "quadrilateral", low, high), stiffness=1e4)
            sheet.clamp(sheet.boundary(lambda x: np.isclose(abs(x[0] - 0.5), 1.0)))
            masters = [sheet.surface(boundary_of(sheet.mesh))]
            bodies.append(sheet)
        elif kind == "facets":
            x = np.linspace(-0.5, 1.5, 21)
            upper = np.column_stack([x[::-1], np.full(21, -GAP)])
            lower = np.column_stack([x, np.full(21, -GAP - THICK)])
            k = np.arange(42)
            sides = np.column_stack([k, (k + 1) % 42])
            masters = [qs.RigidSurface.triangulated(WORLD, np.concatenate([upper, lower]), sides)]
        elif kind == "round":
            masters = [qs.RigidSurface.cylinder(WORLD, [0.53, -0.2], None, 0.2 - GAP)]
        else:
            middles = ([x, -GAP - RADIUS] for x in (0.25, 0.75))
            masters = [qs.RigidSurface.cylinder(WORLD, middle, None, RADIUS) for middle in middles]
        self.contacts = [qs.Contact(slave, master) for master in masters]
        self.problem = problem_of(bodies, self.contacts)

        def push(t, dt=None):
            top.value[1] = -self.DOWN * t

        self.push = push

    def stepped(self, dt, **options):
        """Make steps to the end; return the stepper and the force on the block."""
        stepper = qs.TimeStepper(self.problem, dt, self.push, **options)
        for _ in stepper.run(1.0):
            pass
        return stepper, sum(contact.force("slave")[1] for contact in self.contacts)


@pytest.mark.parametrize("kind", ("facets", "body", "bars", "round"))
def test_large_steps_do_not_pass_through_a_thin_part(kind):
    """Steps by many thicknesses are cut back; the force is that of small steps."""
    stepper, force = OntoASheet(kind).stepped(1.0)
    small, expected = OntoASheet(kind).stepped(0.125)
    assert stepper.num_cutbacks > 0 and small.num_cutbacks == 0
    assert expected > 0.5 and np.isclose(force, expected, rtol=1e-5)
    assert any("passed through a part" in attempt.reason for attempt in stepper.log)


@pytest.mark.parametrize("kind", ("facets", "body", "bars", "round"))
def test_a_solve_says_so(kind):
    """A solve in which the block passes through gives a warning on all ranks."""
    case = OntoASheet(kind)
    case.push(1.0)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        case.problem.solve()
    told = any("through a part of the other surface" in str(w.message) for w in found)
    assert WORLD.allgather(told) == [True] * WORLD.size


def test_length_in_a_bar():
    """The longest path through a bar is its diameter."""
    case = OntoASheet("bars")
    model = case.contacts[0].model
    before = model.placement
    case.push(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has passed through
        case.problem.solve()
    found = find_passed(model, before)
    assert found is not None and found.side == "slave"
    assert found.length == pytest.approx(2 * RADIUS, rel=0.03)


def test_going_around_an_edge_is_no_passing():
    """A block that slides off the sheet's end by many thicknesses in a step is not cut back."""
    case = OntoASheet("facets")
    tool = case.contacts[0].master
    stepper = qs.TimeStepper(case.problem, 1.0)
    for way in ([-0.8, GAP + 0.01], [-0.9, 0.02]):
        stepper.drive = lambda t, dt, way=way: setattr(tool, "displacement", way)
        stepper.step()
    assert stepper.num_cutbacks == 0
