"""Contact nodes with Dirichlet conditions on both sides: planes of symmetry and clamped edges."""

import warnings

import numpy as np
import pytest
from scenes import (
    WORLD,
    box,
    clamp,
    elastic,
    elastic_form,
    largest,
    plane,
    slide,
    vector_space,
)

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

AUGMENTED = "augmented-lagrangian"
PARTITIONS = ("forward", "scattered")


def bodies(cell, n, low=0.0, E=(1.0, 1.0), degree=1):
    """Make two blocks that meet at height 0, the lower one first: spaces, unknowns, forms."""
    up = 1 if cell in ("triangle", "quadrilateral") else 2
    V = []
    for count, bottom, partition in zip(n, (-1.0, 0.0), PARTITIONS, strict=True):
        cells = [count * (2 if low < 0 else 1)] * up + [2]
        corners = [low] * up + [bottom], [1.0] * up + [bottom + 1]
        msh = box(WORLD, cells, cell, *corners, partition)
        V.append(fem.functionspace(msh, ("Lagrange", degree, (up + 1,))))
    u = [fem.Function(space) for space in V]
    return V, u, [elastic(*both) for both in zip(u, E, strict=True)]


def contact_of(V, law, swap=False, **options):
    surfaces = [qs.Surface(s, facets=plane(s.mesh, s.mesh.geometry.dim - 1, 0.0)) for s in V]
    master, slave = surfaces[::-1] if swap else surfaces
    options = {"enforcement": AUGMENTED, "quadrature": "overlay"} | options
    return qs.Contact(slave, master, law=law, **options)


# --- Planes of symmetry


def stretched(whole, n, **options):
    """Solve two tied bars of different stiffness, clamped and pulled; whole or a quarter.

    Returns:
        Force on the upper bar in the quarter x, y > 0, the problem.
    """
    V, u, F = bodies("hexahedron", n, -1.0 if whole else 0.0, E=(1.0, 5.0))
    bcs = []
    for space, end, pull in zip(V, (-1.0, 1.0), (0.0, 0.1), strict=True):
        bcs.append([clamp(space, plane(space.mesh, 2, end), [0.0, 0.0, pull])])
        if not whole:
            bcs[-1] += [slide(space, axis, plane(space.mesh, axis, 0.0)) for axis in (0, 1)]
    solver = options.pop("solver", "direct")
    contact = contact_of(V, qs.Tied(), **options)
    problem = qs.ContactProblem(F, u, [contact], bcs, linear_solver=solver)
    problem.solve()
    p, slave = contact.model.gaps[0], contact.slave
    x = slave.node_x[p.operator.row_node]
    force = p.weight[:, None] * p.multiplier(contact.penalty)
    for axis in (0, 1):
        on = np.isclose(x[:, axis], 0.0)
        force[(x[:, axis] < 0) & ~on] = 0.0
        if whole:  # half, because the mirrored half carries the same, and no force across the plane
            force[on] *= 0.5
            force[on, axis] = 0.0
    return WORLD.allreduce(force.sum(axis=0)), problem


@pytest.mark.parametrize("penalty", (50.0, 1e4))
@pytest.mark.parametrize("enforcement", (AUGMENTED, "penalty"))
@pytest.mark.parametrize("quadrature", ("overlay", "nodal"))
@pytest.mark.parametrize("n", ((3, 2), (2, 3)))
def test_a_quarter_is_a_quarter_of_the_whole(n, quadrature, enforcement, penalty):
    """A quarter has the forces of the whole, also in shear; a large penalty does not lock."""
    options = {"quadrature": quadrature, "enforcement": enforcement, "penalty": penalty}
    force, _ = stretched(True, n, **options)
    quarter_force, quarter = stretched(False, n, **options)
    assert min(abs(force)) > 0.05 * max(abs(force))
    np.testing.assert_allclose(quarter_force, force, rtol=1e-6)
    assert enforcement == AUGMENTED or quarter.num_iterations == 1


# --- Degree 2: nodes next to Dirichlet conditions


@pytest.mark.parametrize("element", ("P2", "Taylor-Hood"))
@pytest.mark.parametrize("law", (qs.Unilateral, qs.Tied))
@pytest.mark.parametrize("master", ("rigid", "deformable"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_no_node_beside_a_plane_of_symmetry_is_held(cell, master, law, element):
    """Nodes beside a plane of symmetry are not held, also in cells with one vertex on it."""
    n = (3, 4) if cell in ("triangle", "quadrilateral") else (2, 3)
    V, u, F = bodies(cell, n, degree=2)
    gdim = V[0].mesh.geometry.dim
    if element == "Taylor-Hood":
        P2 = basix.ufl.element("Lagrange", cell, 2, shape=(gdim,))
        mixed = basix.ufl.mixed_element([P2, basix.ufl.element("Lagrange", cell, 1)])
        W = fem.functionspace(V[1].mesh, mixed)
        V[1], u[1] = W.sub(0), fem.Function(W)
        (displacement, pressure), (v, q) = ufl.split(u[1]), ufl.TestFunctions(W)
        F[1] = elastic_form(displacement, v) + pressure * q * ufl.dx
    surfaces = [qs.Surface(s, facets=plane(s.mesh, gdim - 1, 0.0)) for s in V]
    normal = np.eye(gdim)[-1]
    floor = qs.RigidSurface.plane(WORLD, 0 * normal, normal)
    parts = slice(0, 2) if master == "deformable" else slice(1, 2)
    friction = None if law is qs.Tied else qs.Sticking()
    contact = qs.Contact(
        surfaces[1], surfaces[0] if master == "deformable" else floor, law=law(), friction=friction
    )
    bcs = [[slide(s, axis, plane(s.mesh, axis, 0.0)) for axis in range(gdim - 1)] for s in V[parts]]
    qs.ContactProblem(F[parts], u[parts], [contact], bcs, linear_solver="direct").set_up()
    found = [(gap, gap.extension) for gap in contact.model.gaps]
    found += [(of.by_node, of) for of in contact.model.held_slips]
    assert len(found) == len(contact.model.parts)
    for gap, of in found:
        if of is None:  # no condition along the normal
            assert law is qs.Unilateral
            continue
        x = contact.slave.node_x[gap.operator.row_node, :gdim]
        on_planes = np.isclose(x, 0.0)
        on_planes[:, -1] = False
        np.testing.assert_array_equal(of.held, on_planes)


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
def test_friction_of_degree_2_beside_a_plane_of_symmetry(cell):
    """In full slip, friction is at its limit at every node except those of the planes."""
    n = [4, 4] if cell == "triangle" else [3, 3, 2]
    gdim = len(n)
    V = fem.functionspace(
        box(WORLD, n, cell, [0.0] * gdim, [1.0] * gdim, "scattered"), ("Lagrange", 2, (gdim,))
    )
    u, normal = fem.Function(V), np.eye(gdim)[-1]
    bcs = [slide(V, axis, plane(V.mesh, axis, 0.0)) for axis in range(gdim - 1)]
    bcs.append(slide(V, gdim - 1, plane(V.mesh, gdim - 1, 1.0), -0.05))
    floor = qs.RigidSurface.plane(WORLD, 0 * normal, normal)
    slave = qs.Surface(V, facets=plane(V.mesh, gdim - 1, 0.0))
    contact = qs.Contact(slave, floor, friction=qs.Coulomb(0.02), constraints="nodes")
    qs.ContactProblem([elastic(u)], [u], [contact], [bcs]).solve()
    limit = 0.02 * contact.multiplier()
    along = np.linalg.norm(contact.tangential_multiplier(), axis=1)
    free = ~np.isclose(slave.node_x[:, : gdim - 1], 0.0).any(axis=1)
    np.testing.assert_allclose(along[free], limit[free], rtol=1e-6)


# --- Clamped edges


def strained(cell, n, law, swap=False, solver="direct", degree=1, **options):
    """Solve two blocks of one material whose sides and ends are moved as in uniform strain.

    Returns:
        Displacements minus those of uniform strain, the contact, the problem.
    """
    V, u, F = bodies(cell, n, degree=degree)
    gdim = V[0].mesh.geometry.dim
    strain = np.diag([0.03] * (gdim - 1) + [-0.1])
    strain[0, -1] = 0.05 if law.jump else 0.0
    exact, bcs = [fem.Function(space) for space in V], []
    for space, field, end in zip(V, exact, (-1.0, 1.0), strict=True):
        field.interpolate(lambda x: strain @ x[:gdim])
        sides = [plane(space.mesh, axis, value) for axis in range(gdim - 1) for value in (0.0, 1.0)]
        held = [plane(space.mesh, gdim - 1, end), *sides]
        dofs = (fem.locate_dofs_topological(space, gdim - 1, facets) for facets in held)
        bcs.append([fem.dirichletbc(field, d) for d in dofs])
    contact = contact_of(V, law, swap, **options)
    problem = qs.ContactProblem(F, u, [contact], bcs, linear_solver=solver)
    problem.solve()
    return [a.x.array - b.x.array for a, b in zip(u, exact, strict=True)], contact, problem


#: Options of the blocks and their contact: multigrid, P2 or Q2, constraints at points.
CLAMPED = {
    "direct": {},
    "amg": {"solver": "amg"},
    "degree 2": {"degree": 2},
    "points": {"constraints": "points"},
}


@pytest.mark.parametrize("kind", CLAMPED)
@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("n", ((4, 3), (2, 3)))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_patch_with_clamped_sides(cell, n, law, kind):
    """The patch test passes up to the clamped edges, where multipliers are uniform, too.

    Multipliers there are condensed onto their neighbours; nothing beside them locks.
    """
    if kind == "points" and law is qs.Tied:
        pytest.skip("ties have constraints at nodes")
    errors, contact, _ = strained(cell, n, law(), **CLAMPED[kind])
    assert contact.model.gaps[0].extension is not None
    assert largest(*errors) < 1e-6
    pressure = contact.multiplier() if law is qs.Unilateral else -contact.multiplier()[:, -1]
    expected = abs(contact.force("slave")[-1])  # on a unit area
    assert largest(pressure - expected) < 1e-4 * expected


def test_forces_of_multipliers_that_follow():
    """Forces on condensed multipliers go to their parents by the transpose, also in corners."""
    _, contact, _ = strained("tetrahedron", (2, 3), qs.Unilateral(), constraints="points")
    extension = contact.model.gaps[0].extension
    free, other = (np.sin(s + 1.7 * contact.slave.node_x) for s in (0.0, 1.0))
    free[extension.held] = 0.0
    products = extension.fill(free) * other, free * extension.gather(other)
    left, right = WORLD.allreduce(np.array([product.sum() for product in products]))
    assert left == pytest.approx(right, rel=1e-12)


@pytest.mark.parametrize("quadrature", ("overlay", "nodal"))
def test_clamped_edges_do_not_know_the_penalty(quadrature):
    """Loaded blocks between walls: the penalty has no effect at clamped edges."""
    forces = []
    for penalty in ("auto", 1e3, 1e4):
        V, u, F = bodies("quadrilateral", (4, 6), E=(1.0, 5.0))
        bcs = [[clamp(s, plane(s.mesh, 0, x)) for x in (0.0, 1.0)] for s in V]
        top = np.sort(plane(V[1].mesh, 1, 1.0))
        tags = mesh.meshtags(V[1].mesh, 1, top, np.ones_like(top))
        ds = ufl.Measure("ds", domain=V[1].mesh, subdomain_data=tags)(1)
        load = fem.Constant(V[1].mesh, np.array([0.05, -0.1]))
        F[1] -= ufl.inner(load, ufl.TestFunction(V[1])) * ds
        contact = contact_of(V, qs.Tied(), penalty=penalty, quadrature=quadrature)
        problem = qs.ContactProblem(F, u, [contact], bcs)
        problem.solve()
        forces.append(contact.force("slave"))
    for force in forces[1:]:
        assert largest(force - forces[0]) < 1e-3 * largest(forces[0])


@pytest.mark.parametrize("side", (0, 1))
def test_held_on_one_side_alone(side):
    """With conditions on one side only, the other side closes the gap, and the multiplier stays."""
    V, u, F = bodies("quadrilateral", (4, 3))
    bcs = [
        [clamp(V[0], plane(V[0].mesh, 1, -1.0))],
        [clamp(V[1], plane(V[1].mesh, 1, 1.0), [0.03, 0.1])],
    ]
    bcs[side].append(clamp(V[side], plane(V[side].mesh, 0, 0.0)))
    contact = contact_of(V, qs.Tied())
    problem = qs.ContactProblem(F, u, [contact], bcs)
    problem.solve()
    assert contact.model.gaps[0].extension is None
    assert largest(contact.weighted_gap()) <= 3 * contact.settings.allowed_gap


# --- Prescribed gaps and tools


def warned(call):
    """Return the texts of the contact warnings inside the call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]


SAMPLINGS = {
    "overlay": {"formulation": "master-slave"},
    "nodal": {"formulation": "master-slave", "quadrature": "nodal"},
    "points": {"constraints": "points"},
}


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("enforcement", (AUGMENTED, "penalty"))
@pytest.mark.parametrize("law, sign", ((qs.Unilateral, -1), (qs.Tied, 1)))
def test_prescribed_gaps_are_told_of(law, sign, enforcement, sampling):
    """Prescribed gaps give one warning; no side can close them, and the solve still ends."""
    V, u, F = bodies("quadrilateral", (4, 3))
    bcs = [
        [clamp(space, plane(space.mesh, axis, value), [0.0, shift]) for axis, value in places]
        for space, shift, places in zip(
            V, (0.0, sign * 0.04), ([(1, -1.0), (0, 0.0)], [(1, 1.0), (0, 0.0)]), strict=True
        )
    ]
    if sampling == "points" and law is qs.Tied:
        pytest.skip("ties have constraints at nodes")
    contact = contact_of(V, law(), enforcement=enforcement, **SAMPLINGS[sampling])
    problem = qs.ContactProblem(F, u, [contact], bcs)
    texts = warned(problem.solve)
    assert len(texts) == 1 and texts[0].startswith("bcs: ") and " 0.04, " in texts[0], texts
    assert warned(problem.solve) == []


@pytest.mark.parametrize("law", (qs.Unilateral, qs.Tied))
def test_nothing_to_tell_of_what_moves_together(law):
    assert warned(lambda: strained("quadrilateral", (4, 3), law())) == []


def test_a_driven_tool_is_not_held():
    """Held nodes balance the force of a force-controlled tool: they keep their multipliers."""
    V = vector_space(box(WORLD, (4, 3), "quadrilateral", [0.0, -1.0], [1.0, 0.0], "scattered"))
    u = fem.Function(V)
    every = plane(V.mesh, 1, 0.0)
    bcs = [clamp(V, every), clamp(V, plane(V.mesh, 1, -1.0))]
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, -1.0])
    tool.drive(0.3, [0.0, -1.0])
    contact = qs.Contact(
        qs.Surface(V, facets=every), tool, penalty=10.0, enforcement=AUGMENTED, quadrature="overlay"
    )
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])
    problem.solve()
    np.testing.assert_allclose(contact.force("slave"), [0.0, -0.3], atol=1e-8)
    assert largest(contact.weighted_gap()) <= 3 * contact.settings.allowed_gap


@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("enforcement", (AUGMENTED, "penalty"))
def test_friction_of_half_a_disc(enforcement, constraints):
    """Nothing slips on the plane of symmetry, whatever the facet normals of the half are."""
    forces = []
    for half in (False, True):
        low = 0.0 if half else -1.0
        n = [8 if half else 16, 6]
        msh = box(WORLD, n, "quadrilateral", [low, 0.0], [1.0, 0.8], "scattered")
        V = vector_space(msh)
        u, top = fem.Function(V), plane(msh, 1, 0.8)
        bottom, middle = (plane(msh, axis, 0.0) for axis in (1, 0))
        x = msh.geometry.x
        x[:, 1] += 0.3 * x[:, 0] ** 2 * (1 - x[:, 1] / 0.8)
        bcs = [clamp(V, top, [0.0, -0.02])]
        if half:
            bcs.append(slide(V, 0, middle))
        floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        contact = qs.Contact(
            qs.Surface(V, facets=bottom),
            floor,
            quadrature="overlay",
            enforcement=enforcement,
            constraints=constraints,
            friction=qs.Coulomb(0.3),
            penalty=30.0,
        )
        qs.ContactProblem([elastic(u)], [u], [contact], [bcs]).solve()
        forces.append(contact.force("slave")[1] * (2 if half else 1))
        tau, x = contact.tangential_multiplier()[:, 0], contact.slave.node_x[:, 0]
        # Points of half a patch have a mean, those of multipliers that is not their node's.
        if not half or constraints == "nodes" or enforcement == AUGMENTED:
            assert largest(tau[np.abs(x) < 1e-9]) < 1e-7 * abs(forces[0])
        assert largest(tau) > 1e-3 * abs(forces[0])
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-7 if constraints == "nodes" else 1e-5)
