"""Rigid tools: shapes, triangulations, contact detection, and bodies pressed against them."""

from mpi4py import MPI

import numpy as np
import pytest
from rigid_scenes import TOOLS, Pressed, flat, flat_facets, sphere_facets, write_stl
from scenes import (
    CELLS,
    LAWS,
    WORLD,
    Pair,
    box,
    clamp,
    gathered,
    largest,
    plane,
    raises_everywhere,
)
from tangents import direction, tangent_errors

from dolfinx import mesh

import qsdolfinx as qs
from qsdolfinx.contact import active_set

QUADRATURES = ("nodal", "overlay")


@pytest.mark.parametrize("moved", (False, True))
def test_distances(moved):
    """Distances are those of the closed form, and normals are the gradient of the distance."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(50, 3))
    p, a, c = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, -0.5]), np.array([0.2, 0.1, -0.4])
    unit = a / np.linalg.norm(a)
    across = np.linalg.norm(np.cross(x - c, unit), axis=1)
    flat_x = x * [1, 1, 0]
    make = qs.RigidSurface
    expected = (
        (make.plane(WORLD, p, a), x, (x - p) @ unit),
        (make.sphere(WORLD, c, 0.7), x, np.linalg.norm(x - c, axis=1) - 0.7),
        (make.sphere(WORLD, c, 0.7, inside=True), x, 0.7 - np.linalg.norm(x - c, axis=1)),
        (make.cylinder(WORLD, c, 3 * a, 0.7), x, across - 0.7),
        (make.cylinder(WORLD, c, a, 0.7, inside=True), x, 0.7 - across),
        (make.plane(WORLD, p[:2], a[:2]), flat_x, (flat_x - p)[:, :2] @ a[:2] / np.hypot(1, 2)),
        (make.cylinder(WORLD, c[:2], None, 0.7), flat_x, np.hypot(*(x - c).T[:2]) - 0.7),
    )
    for tool, points, distance in expected:
        R, t = np.eye(3), np.zeros(3)
        if moved:
            tool.displacement[:] = rng.normal(size=tool.gdim)
            tool.rotation = rng.normal(size=tool.rotation.shape)
            tool.advance()
            d = tool.gdim
            R[:d, :d], t[:d] = tool.position[:, :d], tool.position[:, d]
        points = points @ R.T + t
        found, normal = tool.distance(points)
        np.testing.assert_allclose(found, distance, atol=1e-14)
        h = 1e-6
        for i in range(tool.gdim):
            e = h * np.eye(3)[i]
            slope = (tool.distance(points + e)[0] - tool.distance(points - e)[0]) / 2 / h
            np.testing.assert_allclose(normal[:, i], slope, atol=1e-7)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)


SHAPES = {
    "plane": lambda: qs.RigidSurface.plane(WORLD, [0.1, 0.2, 0.3], [0.0, 0.6, 0.8]),
    "ball": lambda: qs.RigidSurface.sphere(WORLD, [0.1, 0.2, 0.3], 0.5),
    "tube": lambda: qs.RigidSurface.cylinder(WORLD, [0.1, 0.2, 0.3], [0.6, 0.0, 0.8], 1.5, True),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_of_normals(shape):
    """They are those of differences, also after the tool has moved and rotated."""
    tool, x, h = SHAPES[shape](), np.random.default_rng(0).normal(size=(5, 3)), 1e-5
    tool.displacement, tool.rotation = [0.2, 0.1, -0.3], [0.8, -0.5, 0.3]
    tool.advance()
    found = tool.curvature(x)
    for k, step in enumerate(h * np.eye(3)):
        change = (tool.distance(x + step)[1] - tool.distance(x - step)[1]) / (2 * h)
        np.testing.assert_allclose(found[:, :, k], change, atol=1e-7)


@pytest.mark.parametrize("cell", CELLS)
def test_facets_of_a_plane_are_the_plane(cell):
    """For a tilted plane, facets give the same gaps, normals and areas at nodes as the plane."""
    scene = Pressed(cell, flat)
    gaps, normals, weights = [], [], []
    for make in (flat, flat_facets):
        tool = make(WORLD, scene.gdim)
        tool.rotation[-1 if scene.gdim == 2 else 0] = 0.1
        tool.displacement[-1] = 0.05
        tool.advance()
        contact = qs.Contact(scene.surface, tool, formulation="master-slave", quadrature="nodal")
        gaps.append(contact.weighted_gap())
        normals.append(contact.pairing.normal)
        weights.append(contact.pairing.weight)
        assert contact.num_unpaired == 0
    assert largest(gaps[0]) > 0.01
    for pair in (gaps, normals, weights):
        np.testing.assert_allclose(*pair, atol=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_what_is_paired(cell):
    """Contact pairs face the tool and are within the radius.

    On the overlay, ``num_unpaired`` counts facets.
    """
    scene = Pressed(cell, flat)
    boundary = mesh.locate_entities_boundary(
        scene.mesh, scene.axis, lambda x: np.ones(x.shape[1], dtype=bool)
    )
    everything = qs.Surface(scene.V, facets=boundary)
    options = {"penalty": 1.0, "quadrature": "overlay"}
    contact = qs.Contact(everything, scene.tool, search_radius=5.0, **options)
    area = WORLD.allreduce(contact.pairing.weight.sum())
    height = largest(contact.pairing.slave.x[:, scene.axis] - 1)
    top = WORLD.allreduce(len(scene.surface.facets))
    every = WORLD.allreduce(len(everything.facets))
    assert np.isclose(area, 1.0, rtol=1e-12)
    assert height < 1e-14
    assert contact.num_unpaired == every - top
    scene.tool.displacement[-1] = 0.2
    scene.tool.advance()
    for radius, paired in ((0.21, top), (0.19, 0)):
        contact = qs.Contact(scene.surface, scene.tool, search_radius=radius, **options)
        assert contact.num_unpaired == top - paired
        assert WORLD.allreduce(len(contact.pairing)) % max(paired, 1) == 0
    nodes = qs.Contact(scene.surface, scene.tool, quadrature="nodal", search_radius=0.19)
    assert nodes.num_unpaired == WORLD.allreduce(len(scene.surface.node_x))


def test_facets_of_a_sphere_converge():
    """Gaps to the facets of a sphere converge with second order in the facet size."""
    scene = Pressed("tetrahedron", flat, n=4)
    center, radius = [0.5, 0.4, 3.0], 2.1
    options = {"quadrature": "nodal", "search_radius": 0.5}
    ball = qs.RigidSurface.sphere(WORLD, center, radius)
    exact = qs.Contact(scene.surface, ball, **options)
    errors = []
    for n in (20, 40):
        tool = sphere_facets(WORLD, n, center, radius)
        contact = qs.Contact(
            scene.surface, tool, formulation="master-slave", normals="facet", **options
        )
        error = np.abs(contact.weighted_gap() - exact.weighted_gap())
        assert np.array_equal(np.isnan(contact.weighted_gap()), np.isnan(exact.weighted_gap()))
        errors.append(largest(np.nan_to_num(error)))
    assert WORLD.allreduce(np.count_nonzero(~np.isnan(exact.weighted_gap()))) > 9
    assert 0 < errors[1] < errors[0] / 3


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", CELLS)
def test_uniform_pressure(cell, tool, quadrature, enforcement):
    """The pressure is that of the closed form; a penalty adds the compliance 1/ε in series."""
    scene = Pressed(cell, TOOLS[tool], quadrature=quadrature, enforcement=enforcement)
    scene.is_uniform(0.01)


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", CELLS)
def test_uniform_pressure_with_degree_2(cell, tool):
    # On segments of uneven quadrilaterals the quadrature is not exact for functions of degree 2.
    uneven = 0.0 if (cell, tool) == ("hexahedron", "facets") else 0.08
    scene = Pressed(cell, TOOLS[tool], 2, degree=2, quadrature="overlay", uneven=uneven)
    scene.is_uniform(0.01)


@pytest.mark.parametrize("cell", CELLS)
def test_quasi_symmetric(cell):
    """Quasi-symmetric contact gives the uniform pressure, integrated on both sides.

    With an analytic shape it equals master-slave contact.
    """
    scene = Pressed(cell, flat_facets, quadrature="overlay", formulation="quasi-symmetric")
    scene.is_uniform(0.01)
    scene = Pressed(cell, flat, formulation="quasi-symmetric")
    scene.is_uniform(0.01)


def test_the_matrix_has_no_rows_for_the_tool():
    scene = Pressed("tetrahedron", flat)
    scene.problem.solve()
    nest = scene.problem.blocks.nest
    rows, columns = nest.getNestISs()
    assert len(rows) == len(columns) == 1
    assert nest.getSizes()[0] == scene.problem.bodies[0].x.getSizes()


def curved(comm, gdim):
    """A ball or circle that dips into the block."""
    center = np.full(gdim, 0.5)
    center[-1] = 2.0 - 0.02
    return qs.RigidSurface.sphere(comm, center, 1.0)


def curved_facets(comm, gdim):
    return sphere_facets(comm, 30, [0.5] * (gdim - 1) + [2.0 - 0.02], 1.0)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("tool", (curved, curved_facets))
@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_finite_differences(cell, tool, quadrature, law):
    """The tangent is the derivative of the residual, and symmetric."""
    n = 10 if cell == "triangle" else 5
    scene = Pressed(
        cell, tool, n=n, quadrature=quadrature, law=law(), formulation="quasi-symmetric"
    )
    scene.tool.displacement[-1] = -0.01
    scene.tool.rotation[0] = 0.02
    problem = scene.problem
    problem.solve()
    x, d = problem.system.x.copy(), direction(problem, np.random.default_rng(8))
    errors = tangent_errors(problem, x, d, 1e-7)
    active = WORLD.allreduce(active_set.num_closed(scene.contact.model))
    rows = WORLD.allreduce(scene.contact.model.gaps[0].num_rows)
    assert errors.difference < 1e-6
    assert errors.asymmetry < 1e-13
    assert active == rows if law is qs.Tied else 0 < active < rows


def test_automatic_penalty_is_that_of_a_constrained_master():
    """With a tool, the automatic penalty has the slave's stiffness alone.

    A constrained master gives the same penalty.
    """
    pair = Pair("triangle", penalty="auto")
    pair.bcs[0].append(clamp(pair.V[0], plane(pair.meshes[0], 1, 0.0)))
    pair.problem().set_up()
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(pair.slave, tool)
    qs.ContactProblem(pair.F[1:], pair.u[1:], [contact], pair.bcs[1:]).set_up()
    assert np.isclose(contact.penalty, pair.contact.penalty, rtol=1e-12)


def test_results():
    scene = Pressed("hexahedron", flat)
    scene.tool.displacement[-1] = -0.01
    scene.problem.solve()
    contact = scene.contact
    pressure = contact.force("master")[2]
    about_corner = contact.moment("master", [0.0, 0.0, 0.0])
    np.testing.assert_allclose(contact.moment("master"), 0, atol=1e-12)
    np.testing.assert_allclose(about_corner, [pressure / 2, -pressure / 2, 0], atol=1e-12)
    np.testing.assert_allclose(contact.moment("slave", [0.0] * 3), -about_corner, atol=1e-14)
    assert np.isclose(contact.patch()[0], 1.0)
    raises_everywhere(WORLD, ValueError, "no traction", lambda: contact.traction("master"))
    raises_everywhere(WORLD, ValueError, "no multiplier", lambda: contact.weighted_gap("master"))
    raises_everywhere(WORLD, ValueError, "no gaps", lambda: contact.gap("master"))


@pytest.mark.parametrize("tool", (curved, curved_facets))
def test_ranks_do_not_matter(tool):
    results = []
    for comm in (WORLD, MPI.COMM_SELF):
        scene = Pressed("tetrahedron", tool, n=4, comm=comm, formulation="quasi-symmetric")
        scene.tool.drive(0.02, [0, 0, -1.0])
        scene.problem.solve()
        results.append(
            (
                scene.tool.displacement[2],
                scene.contact.stored_energy(),
                comm.allreduce(len(scene.contact.pairing)),
                comm.allreduce(np.nansum(scene.contact.weighted_gap())),
            )
        )
    assert results[0][2] > 5
    np.testing.assert_allclose(results[0], results[1], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("binary", (False, True))
def test_stl(tmp_path_factory, binary):
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("stl")), root=0)
    x = np.array([[-1, -1, 1], [2, -1, 1], [2, 2, 1], [-1, 2, 1.0]])
    triangles = np.array([[0, 2, 1], [0, 3, 2]])
    if WORLD.rank == 0:
        write_stl(folder + "/tool.stl", x[triangles], binary)
    scene = Pressed(
        "tetrahedron", lambda comm, _: qs.RigidSurface.from_stl(comm, folder + "/tool.stl")
    )
    scene.is_uniform(0.01)
    np.testing.assert_allclose(scene.tool.center, [0.5, 0.5, 1.0])
    if WORLD.rank == 0:
        with open(folder + "/no.stl", "w") as file:
            file.write("solid nothing\nendsolid\n")
    WORLD.barrier()
    for name, match in (("no.stl", "no STL file"), ("missing.stl", "cannot be read")):
        raises_everywhere(
            WORLD,
            ValueError,
            match,
            lambda name=name: qs.RigidSurface.from_stl(WORLD, f"{folder}/{name}"),
        )


@pytest.mark.parametrize("cell", CELLS)
def test_surface_mesh(cell):
    """A tool may be a sub-mesh of facets with cells of any orientation."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    low, high = [-1.0] * (gdim - 1) + [1.0], [2.0] * gdim
    other = box(WORLD, [4] * gdim, cell, low, high, "backward")
    facets = plane(other, gdim - 1, 1.0)
    part = mesh.create_submesh(other, gdim - 1, facets)[0]
    scene = Pressed(
        cell,
        lambda comm, _: qs.RigidSurface.from_mesh(part, inside=[0.5] * (gdim - 1) + [9.0]),
        quadrature="overlay",
    )
    scene.is_uniform(0.01)
    assert gathered(WORLD, scene.contact.multiplier()).min() > 0


def test_bad_contacts():
    quadratic = Pressed("triangle", flat, degree=2, quadrature="overlay")
    nodal = lambda: qs.Contact(quadratic.surface, quadratic.tool, quadrature="nodal")  # noqa: E731
    raises_everywhere(WORLD, ValueError, "quadrature", nodal)
    quadratic.tool.displacement[0] = np.nan
    raises_everywhere(WORLD, ValueError, "displacement", quadratic.problem.solve)
