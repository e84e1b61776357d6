"""Constraints at contact quadrature points: inactive points do not change active points."""

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, problem_of, rotation
from scenes import (
    CELLS,
    WORLD,
    Pair,
    box,
    clamp,
    elastic,
    gathered,
    largest,
    plane,
    raises_everywhere,
    vector_space,
)
from slanted import slanted_block
from tangents import direction, near_solution, tangent_errors

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import active_set

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
POINTS = {"quadrature": "overlay", "constraints": "points", "enforcement": "penalty"}
AUGMENTED = POINTS | {"enforcement": "augmented-lagrangian"}


def cells_along(cell):
    return (3, 2) if cell in ("tetrahedron", "hexahedron") else (12, 9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_tangent(cell, formulation):
    """The tangent is the derivative of the forces, these of the energy; some points are open."""
    options = POINTS if formulation == "double-pass" else AUGMENTED | {"gap_tolerance": 0.01}
    n = cells_along(cell)
    eps = 2.0 if options is POINTS else 30.0  # soft enough that there are no multipliers
    pair = Pair(cell, formulation, penalty=eps, n=n, wave=0.05, contact_options=options)
    problem = pair.problem()
    problem.solve()
    rng = np.random.default_rng(8)
    x, d = near_solution(problem, rng, 0.2), direction(problem, rng)
    errors = tangent_errors(problem, x, d, 1e-7)
    active = WORLD.allreduce(active_set.num_closed(pair.contact.model))
    assert 0 < active < WORLD.allreduce(sum(p.num_rows for p in pair.contact.model.gaps))
    assert errors.difference < 1e-6
    assert errors.asymmetry < 1e-13

    def energy(step):
        problem.system.residual(x.array_r + step * d.array_r)
        return pair.contact.stored_energy()

    slope = (energy(1e-6) - energy(-1e-6)) / 2e-6
    problem.system.residual(x.array_r)
    forces = np.concatenate([body.force.array_r for body in problem.bodies])
    assert np.isclose(WORLD.allreduce(forces @ d.array_r), slope, rtol=1e-6)


def tractions(pair, master, slave, options):
    """Return tractions of the contact between the blocks in any roles: on the lower, the upper."""
    for u in pair.u:
        u.x.array[:] = 0
    contact = qs.Contact(slave, master, penalty=2.0, **options)
    problem = qs.ContactProblem(pair.F, pair.u, [contact], pair.bcs)
    problem.solve()
    of = {slave: contact.traction("slave"), master: contact.traction("master")}
    return [s.node_values(of[s]) for s in (pair.master, pair.slave)]


@pytest.mark.parametrize("cell", ("tetrahedron", "quadrilateral"))
def test_exchange_of_slave_and_master(cell):
    """Quasi-symmetric contact at points does not change when slave and master are exchanged."""
    pair = Pair(cell, n=cells_along(cell), wave=0.05)
    there = tractions(pair, pair.master, pair.slave, POINTS)
    back = tractions(pair, pair.slave, pair.master, POINTS)
    errors = [largest(a - b) for a, b in zip(there, back, strict=True)]
    size = largest(*there)
    one_sided = POINTS | {"formulation": "master-slave"}
    other = [tractions(pair, *roles, one_sided)[0] for roles in
             ((pair.master, pair.slave), (pair.slave, pair.master))]  # fmt: skip
    differs = largest(other[0] - other[1])
    assert max(errors) < 1e-10 * size
    assert differs > 1e-3 * size


#: Options of a contact, and its penalty.
PENALTIES = {"soft": (POINTS, 30.0), "stiff": (POINTS, 3e3), "augmented": (AUGMENTED, 30.0)}


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("kind", PENALTIES)
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", CELLS)
def test_patch(cell, formulation, kind, degree):
    """A uniform pressure passes through any meshes unchanged, with the penalty that was given.

    Points use all nodes of the trace of degree 2, and multipliers the vertices.
    """
    options, eps = PENALTIES[kind]
    given = {"penalty": eps, "n": cells_along(cell), "contact_options": options}
    space = lambda msh: fem.functionspace(msh, ("Lagrange", degree, (msh.geometry.dim,)))  # noqa: E731
    pair = Pair(cell, formulation, space=space, **given)
    pair.F = [elastic(u, E=1.0 + i, nu=0.0) for i, u in enumerate(pair.u)]
    problem = pair.problem()
    problem.solve()
    compliance = 1 / 1 + 1 / 2 + (1 / eps if options is POINTS else 0)
    for side, sign in (("slave", 1), ("master", -1)):
        force = pair.contact.force(side)
        assert np.isclose(force[-1], sign * 0.1 / compliance, rtol=1e-9)
        if degree == 2:
            continue
        traction = getattr(pair, side).node_values(pair.contact.traction(side))
        expected = np.zeros(traction.shape)
        expected[:, -1] = sign * 0.1 / compliance
        assert largest(traction - expected) < 1e-9
    assert largest(pair.contact.multiplier() - 0.1 / compliance) < 1e-9


@pytest.mark.parametrize(("cell", "kind"), (("tetrahedron", "body"), ("hexahedron", "tool")))
def test_turned_scene(cell, kind):
    """Rotating a scene with partial contact rotates its forces, and nothing else changes."""
    turns = np.eye(3), rotation(0.5 * np.pi, [0, 0, 1]), rotation(1.3, [0.3, -0.5, 0.8])
    tilt = rotation(0.04, [0.8, 0.6, 0.0])
    forces = []
    for turn in turns:
        lower = Body(box(WORLD, (3, 2, 2), cell, [0.0, 0.0, 0.0], [1.5, 1.0, 1.0]))
        face, ground = plane(lower.mesh, 2, 1.0), plane(lower.mesh, 2, 0.0)
        bodies, master, load = [lower], None, turn @ [0.004, 0.002, -0.02]
        if kind == "body":
            upper = Body(box(WORLD, (2, 2, 1), cell, [0.2, 0.1, 1.0], [1.3, 0.9, 1.6]))
            under, top = plane(upper.mesh, 2, 1.0), plane(upper.mesh, 2, 1.6)
            upper.mesh.geometry.x[:] = (upper.mesh.geometry.x - [0, 0, 1]) @ tilt.T + [0, 0, 1.02]
            bodies.append(upper)
        for body in bodies:
            body.mesh.geometry.x[:] = body.mesh.geometry.x @ turn.T
        lower.clamp(ground)
        if kind == "body":
            upper.clamp(top, load)
            master = upper.surface(under)
        else:
            corners = np.array([[0.2, 0.1, 0], [1.3, 0.1, 0], [1.3, 0.9, 0], [0.2, 0.9, 0]])
            corners = (corners @ tilt.T + [0, 0, 1.02]) @ turn.T
            master = qs.RigidSurface.triangulated(WORLD, corners, [[0, 2, 1], [0, 3, 2]])
            master.displacement = load
        contact = qs.Contact(lower.surface(face), master, friction=qs.Coulomb(0.2))
        problem_of(bodies, [contact]).solve()
        forces.append(turn.T @ contact.force("slave"))
        assert 0 < contact.report().active < contact.report().rows
    np.testing.assert_allclose(forces[1:], [forces[0]] * 2, rtol=0, atol=1e-8 * largest(forces[0]))


def test_ranks_do_not_matter():
    found = []
    for comm in (WORLD, MPI.COMM_SELF):
        pair = Pair("tetrahedron", n=(4, 3), wave=0.05, comm=comm, contact_options=AUGMENTED)
        problem = pair.problem()
        problem.solve()
        contact = pair.contact
        at_nodes = [contact.weighted_gap(), contact.multiplier(), contact.active().astype(float)]
        columns = gathered(comm, np.column_stack([pair.slave.node_x, *at_nodes]))
        columns = columns[np.lexsort(np.round(columns[:, :3], 9).T)]
        totals = contact.stored_energy(), contact.patch(), contact.weighted_penetration()
        found.append((columns, contact.force("slave"), *totals))
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, rtol=1e-6, atol=1e-9)


def test_out_of_contact():
    """Without contact, linear bodies take one iteration, and none if they are at rest."""
    pair = Pair("triangle", n=(12, 9), gap=0.3, load=-0.05, contact_options=AUGMENTED)
    problem = pair.problem()
    counts = []
    for _ in range(2):
        problem.solve()
        counts.append(problem.num_iterations)
    assert counts[0] <= 2 and counts[1] == 0 and not pair.contact.active().any()
    assert pair.contact.stored_energy() == 0 and largest(pair.contact.force("slave")) == 0


@pytest.mark.parametrize("cell", ("hexahedron", "triangle"))
def test_ignored_overclosure(cell):
    """With ignored overclosure, surfaces that overlap by different depths have no force."""
    options = POINTS | {"initial_overclosure": "ignore"}
    pair = Pair(cell, n=cells_along(cell), gap=-0.02, wave=0.05, load=0.0, contact_options=options)
    problem = pair.problem()
    problem.solve()
    force = pair.contact.force("slave")
    depth = pair.contact.model.overclosure.depth
    pair.contact.allow_overclosure(0.0)
    problem.solve()
    assert depth > 0.02
    assert largest(force) == 0
    assert np.abs(pair.contact.force("slave")[-1]) > 1e-3


def test_crease():
    """Open points on the sides above the floor do not lift the corner's points off the floor."""
    stiff = {"penalty": 100 * 1e3 * 8}
    depths = [slanted_block(constraints=c, **stiff)[1] for c in ("nodes", "points")]
    assert depths[0] > 5e-3
    assert depths[1] < 5e-4


def test_friction_at_a_crease():
    """At a sharp edge friction acts at points, and its limit is the one of their pressure."""
    stiff = {"penalty": 100 * 1e3 * 8, "friction": qs.Coulomb(0.05)}
    contact, depth = slanted_block(constraints="points", **stiff)
    assert depth < 5e-4
    assert WORLD.allreduce(int(contact.model.slips[0].slipping.sum())) > 0
    for slip in contact.model.slips:
        size = np.linalg.norm(slip.state.response.traction, axis=1)
        limit = 0.05 * slip.state.pressure
        assert largest(np.maximum(size - limit, 0)) <= 1e-12 * largest(limit)
        np.testing.assert_allclose(size[slip.slipping], limit[slip.slipping], rtol=1e-9)


@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
@pytest.mark.parametrize("gdim, n, tool", ((2, 8, "plane"), (2, 8, "facets"), (3, 4, "plane")))
@pytest.mark.parametrize("finite", (False, True))
def test_multipliers_at_a_crease(finite, gdim, n, tool, formulation):
    """Each smooth patch has its own multipliers: no corner stays below the floor."""
    options = {"formulation": formulation, "enforcement": "augmented-lagrangian"}
    contact, depth = slanted_block(gdim, n, tool, finite, constraints="points", **options)
    assert depth < 1e-6 and contact.penetration() < 1e-4
    assert contact.report().advice == ""
    if gdim == 2:
        assert abs(contact.force("slave")[1] - 78.81) < 0.005


def test_sides_on_a_round_surface():
    """Facets that meet at less than 30° belong to one smooth patch, others to different patches."""
    found = []
    for n in (16, 8):  # angles of 22.5 and 45 degrees
        msh = box(WORLD, (n, 1), "quadrilateral", (0.0, 1.0), (1.0, 2.0), "scattered")
        angle, r = -2 * np.pi * msh.geometry.x[:, 0], msh.geometry.x[:, 1].copy()
        msh.geometry.x[:, :2] = (r * np.array([np.cos(angle), np.sin(angle)])).T
        V = vector_space(msh)
        outside = mesh.locate_entities_boundary(
            msh, 1, lambda x: np.hypot(x[0], x[1]) > 2 * np.cos(np.pi / n) - 1e-9
        )
        tool = qs.RigidSurface.plane(WORLD, point=[3, 0], normal=[-1, 0])
        radius = {"search_radius": 10.0}
        contact = qs.Contact(qs.Surface(V, facets=outside), tool, **AUGMENTED | radius)
        cover = contact.model.gaps[0].rows.cover_of_sides
        found.append(WORLD.allreduce(np.count_nonzero(cover > 1e-9, axis=0)).tolist())
    assert found[0][1] == 0 < found[0][0]
    assert found[1][1] > 0


def test_large_facets_beside_the_contact():
    """A wedge with long sides: the force does not depend on the search radius."""
    msh = box(WORLD, (16, 8), "quadrilateral", (-1.0, -1.0), (1.0, 0.0), "scattered")
    V = vector_space(msh)
    held = clamp(V, plane(msh, 1, -1.0))
    x = np.array([[-2.0, 5.0], [-0.3, 0.0], [0.3, 0.0], [2.0, 5.0]])
    found = {}
    for constraints in ("nodes", "points"):
        for radius in (0.06, 5.0):
            tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2], [2, 3]])
            tool.displacement[1] = -0.05
            u = fem.Function(V)
            surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
            options = POINTS | {"constraints": constraints, "search_radius": radius}
            contact = qs.Contact(surface, tool, penalty=20.0, **options)
            qs.ContactProblem([elastic(u)], [u], [contact], [[held]]).solve()
            found[constraints, radius] = contact.force("slave")[1]
    for constraints in ("nodes", "points"):
        assert np.isclose(found[constraints, 0.06], found[constraints, 5.0], rtol=1e-9)


def test_penetration_is_that_of_the_points():
    contact, depth = slanted_block(constraints="points", enforcement="penalty")
    assert 0.8 * depth < contact.weighted_penetration() <= depth


@pytest.mark.parametrize("rigid", (False, True))
def test_what_can_be_read(rigid):
    """Results of a narrow slave in the middle of a wide master, or of a tool."""
    pair = Pair("quadrilateral", n=(7, 5))
    x = pair.meshes[1].geometry.x
    x[:, 0] = 0.3 + 0.4 * x[:, 0]
    pair.slave.update()
    floor = qs.RigidSurface.plane(WORLD, point=[0, 0], normal=[0, 1])
    contact = qs.Contact(pair.slave, floor if rigid else pair.master, penalty=30.0, **POINTS)
    bodies = slice(1, 2) if rigid else slice(0, 2)
    qs.ContactProblem(pair.F[bodies], pair.u[bodies], [contact], pair.bcs[bodies]).solve()
    gap, multiplier, active = contact.weighted_gap(), contact.multiplier(), contact.active()
    report, (width, _) = contact.report(), contact.patch()
    assert np.all(active) and np.all(gap > 0)
    np.testing.assert_allclose(multiplier, 30 * gap, rtol=1e-12)
    assert np.isclose(width, 0.4)
    assert report.slave.missed == 0 and report.active == report.rows == report.points > 0
    if not rigid:
        status, traction = contact.status("master"), contact.traction("master")
        reached = pair.master.node_values(traction)[:, 1] < 0
        shown = np.zeros(len(reached))
        V = status.function_space
        places = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
        for i, node in enumerate(pair.master.node_x):
            nearest = np.argmin(np.linalg.norm(places - node, axis=1))
            shown[i] = status.x.array[nearest]
        x = pair.master.node_x[:, 0]
        assert np.array_equal(reached, (x > 0.3 - 1 / 7) & (x < 0.7 + 1 / 7))
        assert np.array_equal(shown == qs.Status.ACTIVE, reached)


def test_refused():
    pair = Pair("triangle")
    surfaces = pair.slave, pair.master
    for match, options in {
        "overlay": {"quadrature": "nodal"},
        "tied": {"law": qs.Tied()},
    }.items():
        raises_everywhere(
            WORLD, ValueError, match, lambda o=options: qs.Contact(*surfaces, **(POINTS | o))
        )
    raises_everywhere(
        WORLD, ValueError, "constraints", lambda: qs.Contact(*surfaces, constraints="facets")
    )


@pytest.mark.parametrize("constraints", ("nodes", "points"))
def test_a_tool_that_leaves(constraints):
    """A linear body that is released is at rest: steps end at rounding level."""
    msh = box(WORLD, (8, 4), "quadrilateral", [0.0, 0.0], [1.0, 0.5])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.5], [0.0, -1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.5)), tool, constraints=constraints)
    bcs = [[clamp(V, plane(msh, 1, 0.0))]]
    problem = qs.ContactProblem([elastic(u, E=100.0)], [u], [contact], bcs)
    ways = iter((-0.02, 0.03, 0.01, 0.01, -0.05))

    def drive(t, dt):
        tool.displacement = [0.0, next(ways)]

    stepper, iterations = qs.TimeStepper(problem, 1.0, drive), []
    for _ in stepper.run(5.0):
        iterations.append(problem.num_iterations)
    assert stepper.num_cutbacks == 0 and max(iterations) <= 6
    assert contact.force("slave")[1] < -0.1
