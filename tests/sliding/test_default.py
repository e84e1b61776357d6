"""Default sliding of contacts: which contacts use updated geometry."""

import warnings

import numpy as np
import pytest
from curved_scenes import ShrinkFit, exact_pressure
from following import Body, Boxes, but_for
from following import problem_of as following_problem
from scenes import WORLD, Pair, box, clamp, elastic, largest, plane, vector_space
from wedges import Wedge

import ufl
from dolfinx import fem

import qsdolfinx as qs


def boxes(n=((4, 2), (3, 2)), cell="quadrilateral", **options):
    """Make a neo-Hookean block on another one, whose top moves down and sideways by a facet."""
    case = Boxes(cell, n, ((1.2, 0.5), (1.0, 0.5)), start=0.1)
    case.lower.clamp(plane(case.lower.mesh, 1, -0.5))
    case.upper.clamp(plane(case.upper.mesh, 1, 0.5), [0.3, -0.02])
    contact = qs.Contact(case.above, case.below, **options)
    return case, contact, case.problem(contact)


def test_nonlinear_bodies():
    """The default for nonlinear bodies is finite sliding; a sliding that is given remains."""
    found = {}
    for sliding in (None, "finite", "small"):
        case, contact, problem = boxes(sliding=sliding)
        assert contact.sliding == (sliding or "finite")
        problem.solve()
        found[sliding] = case.upper.u.x.array.copy()
    assert boxes(normals="facet")[1].sliding == "finite"  # there are no other normals
    assert largest(found[None] - found["finite"]) < 1e-12
    assert largest(found[None] - found["small"]) > 1e-4


def test_linear_bodies():
    """Small in a solve, finite in time steps; a given sliding, and one already solved, remain."""
    pair = Pair("triangle")
    problem = pair.problem()
    assert pair.contact.sliding == "small"
    qs.TimeStepper(problem, 1.0)
    assert pair.contact.sliding == "finite"
    for asked, solved in (("small", False), (None, True)):
        pair = Pair("triangle", contact_options={"sliding": asked})
        problem = pair.problem()
        if solved:
            problem.solve()
        qs.TimeStepper(problem, 1.0)
        assert pair.contact.sliding == "small"


@pytest.mark.parametrize(
    "degree, misfit, sliding", [(1, 0.01, "small"), (2, 0.01, "finite"), (1, 0.5, "finite")]
)
def test_curved_facets(degree, misfit, sliding):
    """Small where finite sliding would take curved facets as flat, if this changes the gaps."""
    scene = ShrinkFit(((16, 5), (22, 7)), misfit=misfit, degrees=("elevated", degree))
    assert scene.contact.sliding == "small"
    stepper = qs.TimeStepper(scene.problem(), 1.0)
    assert scene.contact.sliding == sliding
    if misfit == 0.01:
        stepper.step()
        for side in ("slave", "master"):
            mean, scatter = scene.pressure(side)
            assert abs(mean / exact_pressure() - 1) < 0.01 and scatter < 0.01 * exact_pressure()


@pytest.mark.parametrize("friction, within", [(None, 1e-7), (qs.Coulomb(0.3), 1e-4)])
def test_degree_of_the_rule(friction, within):
    """Degree 2 between hexahedra with finite sliding, unless given, gives nearly the same."""
    forces = []
    for options, expected in (({}, 2), ({"quadrature_degree": 4}, 4), ({"sliding": "small"}, 4)):
        low = Body(box(WORLD, (4, 4, 2), "hexahedron", (0, 0, -0.5), (1, 1, 0)), stiffness=1e3)
        high = Body(box(WORLD, (3, 3, 2), "hexahedron", (0.1, 0.1, 0), (0.8, 0.8, 0.5)))
        low.clamp(plane(low.mesh, 2, -0.5))
        high.clamp(plane(high.mesh, 2, 0.5), (0.1, 0.0, -0.02))
        contact = qs.Contact(high.side(2, 0.0), low.side(2, 0.0), friction=friction, **options)
        problem = following_problem([low, high], [contact])
        assert contact.settings.quadrature_degree == expected
        problem.solve()
        forces.append(contact.force("slave"))
    assert largest(forces[0] - forces[1]) < within * largest(forces[1])


def test_creases():
    """In 3D sliding is small if sharp edges lie ahead of facets, finite for blocks with walls."""
    low = Body(box(WORLD, (4, 4, 2), "hexahedron", (0, 0, -0.5), (1, 1, 0)), stiffness=1e3)
    high = Body(box(WORLD, (3, 3, 3), "hexahedron", (0.2, 0.2, 0), (0.8, 0.8, 0.5)), stiffness=1e3)
    below, above = plane(low.mesh, 2, -0.5), plane(high.mesh, 2, 0.5)
    low.clamp(below)
    top = high.clamp(above)
    contact = qs.Contact(but_for(high, above), but_for(low, below))
    problem = following_problem([low, high], [contact])
    assert contact.sliding == "finite"
    forces = []
    for x in (0.0, 0.4):  # by two facets: a third of the block overhangs
        top.value[[0, 2]] = x, -0.02
        problem.solve()
        forces.append(contact.force("slave")[2])
    assert 0.5 * forces[0] < forces[1] < 0.9 * forces[0]


def crossed_wedges(sliding):
    """Make two neo-Hookean wedges whose edges cross and penetrate each other."""
    upper, lower = Wedge(4, "hexahedron"), Wedge(5, "hexahedron", True, 90.0, (0.03, -0.07, 0.0))
    bodies = [upper.hold(-0.03), lower.hold(0.0)]
    stress = [qs.materials.neo_hookean(body.u, 400.0, 600.0) for body in bodies]
    F = [
        ufl.inner(P, ufl.grad(ufl.TestFunction(body.V))) * ufl.dx(degree=2)
        for P, body in zip(stress, bodies, strict=True)
    ]
    contact = qs.Contact(upper.surface(), lower.surface(), sliding=sliding)
    us, bcs = [body.u for body in bodies], [body.bcs for body in bodies]
    return contact, qs.ContactProblem(F, us, [contact], bcs)


def test_edges_that_cross():
    """Small sliding handles crossing edges and is the default there; finite sliding warns."""
    contact, problem = crossed_wedges(None)
    assert contact.sliding == "small"
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ContactWarning)
        problem.solve()
    force = contact.force("slave")[2]
    contact, problem = crossed_wedges("finite")
    with pytest.warns(qs.ContactWarning, match='edges of both surfaces cross .* take sliding="sm'):
        problem.solve()
    assert contact.force("slave")[2] < 0.5 * force


@pytest.mark.parametrize("kind", ("facets", "plane", "body"))
def test_what_slides_far_in_small_sliding(kind):
    """A warning from one facet of sliding on; none on an analytic plane, where it is exact."""
    msh = box(WORLD, (6, 3), "triangle", [0.0, 0.0], [1.0, 0.5])
    V = vector_space(msh)
    u, bcs = [fem.Function(V)], [[clamp(V, plane(msh, 1, 0.5), [0.0, -0.01])]]
    if kind == "body":
        lower = box(WORLD, (20, 2), "triangle", [-1.0, -0.5], [3.0, 0.0])
        W = vector_space(lower)
        u.append(fem.Function(W))
        bcs.append([clamp(W, plane(lower, 1, -0.5))])
        master = qs.Surface(W, facets=plane(lower, 1, 0.0))
    elif kind == "plane":
        master = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    else:
        x = np.array([[3.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
        master = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2]], [0.0, 0.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), master)
    problem = qs.ContactProblem([elastic(w) for w in u], u, [contact], bcs)
    for facets in (0.0, 0.9, 1.2, 2.0):
        if kind == "body":
            bcs[0][0].g.value[0] = facets / 6
        else:
            master.displacement = [-facets / 6, 0.0]
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            problem.solve()
        told = [w for w in found if "has slid by" in str(w.message)]
        assert len(told) == (facets == 1.2 and kind != "plane")


@pytest.mark.parametrize(("angle", "expected"), ((0.0, 0), (0.05, 0), (1.5, 1)))
def test_roller_that_turns_in_small_sliding(angle, expected):
    """Rotation by facets in place warns: points that were in contact left, and none came."""
    msh = box(WORLD, (12, 3), "quadrilateral", [-0.6, -0.3], [0.6, 0.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.cylinder(WORLD, [0.0, 0.48], None, 0.5)
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, -0.3))]])
    tool.rotation = angle
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        problem.solve()
    assert len([w for w in found if "has slid by" in str(w.message)]) == expected


def test_one_of_many():
    """Contacts are finite between nonlinear bodies, or between a tool and a nonlinear body."""
    V, u, F, contacts, bcs = [], [], [], [], []
    for i in range(2):
        msh = box(WORLD, (3, 3), "triangle", [2.0 * i, 0.0], [2.0 * i + 1, 1.0])
        V.append(vector_space(msh))
        u.append(fem.Function(V[-1]))
        tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        contacts.append(qs.Contact(qs.Surface(V[-1], facets=plane(msh, 1, 1.0)), tool))
        bcs.append([])
    stress = qs.materials.neo_hookean(u[1], 1.0, 1.0)
    F = [elastic(u[0]), ufl.inner(stress, ufl.grad(ufl.TestFunction(V[1]))) * ufl.dx]
    assert [contact.sliding for contact in contacts] == ["small", "small"]
    qs.ContactProblem(F, u, contacts, bcs)
    assert [contact.sliding for contact in contacts] == ["small", "finite"]


def test_refused_problems_change_nothing():
    """A problem with wrong solver options is refused and leaves the contact as it was made."""
    case, contact, _ = boxes(sliding="small")
    contact = qs.Contact(case.above, case.below)
    with pytest.raises(ValueError, match="snes_type"):
        case.problem(contact, petsc_options={"snes_type": "ngmres"})
    assert contact.sliding == "small"


STAY = {
    "nodal": {"quadrature": "nodal"},
    "nodes": {"constraints": "nodes"},
    "bisector": {"normals": "bisector"},
    "double-pass": {"formulation": "double-pass"},
    "velocity": {"unknown": "velocity", "dt": 1.0},
}


@pytest.mark.parametrize("options", STAY.values(), ids=STAY)
def test_small_where_it_cannot_follow(options):
    assert boxes(**options)[1].sliding == "small"


def test_what_has_been_solved_for():
    """A contact already solved keeps its sliding in a problem with other forms."""
    pair = Pair("triangle")
    pair.problem().solve()
    stress = qs.materials.neo_hookean(pair.u[0], 1.0, 1.0)
    form = ufl.inner(stress, ufl.grad(ufl.TestFunction(pair.V[0]))) * ufl.dx
    problem = qs.ContactProblem([form, pair.F[1]], pair.u, [pair.contact], pair.bcs)
    assert pair.contact.sliding == "small"
    problem.solve()
