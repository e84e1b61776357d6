"""docs/limits.md: all input that it lists as refused is refused, with the message shown there."""

import pathlib
import re

from petsc4py import PETSc

import numpy as np
import pytest
from base.malformed_scene import Scene
from contact.bond import Bond
from curved_scenes import Shell, ShrinkFit
from friction.weakening import Weakening
from rigid_scenes import write_stl
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    elevated,
    plane,
    raises_everywhere,
    vector_space,
)
from step_scenes import Upset, refuse

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.steps.checkpoint import Checkpoint

PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "limits.md"


def messages():
    """Messages in the tables of the page."""
    return re.findall(r"^\| .* \| `(.*)` \|$", PAGE.read_text(encoding="utf-8"), re.M)


def surface(V, **more):
    return qs.Surface(V, facets=plane(V.mesh, V.mesh.geometry.dim - 1, 0.0), **more)


def square(**more):
    return box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0], **more)


def on_square(element, **more):
    return surface(fem.functionspace(square(), element), **more)


def prisms():
    corners = [[0.0] * 3, [1.0] * 3]
    msh = mesh.create_box(WORLD, corners, [2, 2, 2], mesh.CellType.prism)
    qs.Surface(vector_space(msh), facets=np.zeros(0, dtype=np.int32))


def bonded(s, **options):
    options = {"law": Bond(0.5, 0.2), "penalty": 10.0} | options
    qs.Contact(s.pair.slave, s.pair.master, **options)


def weakening_by_damage():
    law = Weakening(0.5, 0.2, 0.1)
    law.memory = {"damage": 0.0}
    return law


def jumps_of_a_mini_body():
    W = materials.mini_space(square())
    w, q = fem.Function(W), ufl.TestFunctions(W)[1]
    u, p = ufl.split(w)
    F = materials.incompressible(w, materials.newtonian(u, 1.0))
    F += ufl.jump(p) * ufl.jump(q) * ufl.dS
    qs.ContactProblem([F], [w], [], linear_solver="schur")


def new_mesh(made):
    qs.remesh(made, 0.5)


def new_meshes_of_displacements():
    pair = Pair("triangle")
    remesh = qs.Remeshing(lambda meshes, tags: None, 0.5)
    qs.TimeStepper(pair.problem(), 0.1, remesh=remesh)


def fields_on(contact):
    return [
        qs.Surface(fem.functionspace(s.mesh, ("Lagrange", 1)), facets=s.facets)
        for s in (contact.slave, contact.master)
    ]


def field_of_itself():
    msh = square()
    msh.topology.create_connectivity(1, 2)
    surface = qs.Surface(vector_space(msh), facets=mesh.exterior_facet_indices(msh.topology))
    contact = qs.Contact(surface, surface)
    V = fem.functionspace(msh, ("Lagrange", 1))
    parts = (qs.Surface(V, facets=plane(msh, 0, x)) for x in (0.0, 1.0))
    qs.Contact(*parts, law=qs.Conductance(1.0), mechanics=contact)


def field_at_once():
    pair = Pair("triangle", contact_options={"sliding": "finite"})
    fields = fields_on(pair.contact)
    heat = qs.Contact(*fields, law=qs.Conductance(1.0), mechanics=pair.contact)
    T = [fem.Function(surface.V) for surface in fields[::-1]]
    forms = [qs.materials.heat(t, 1.0) for t in T]
    conditions = [*pair.bcs, [], []]
    qs.ContactProblem(pair.F + forms, pair.u + T, [pair.contact, heat], conditions)


def not_convex():
    msh = box(WORLD, [1, 1, 1], "hexahedron", [0, 0, 0], [1, 1, 1])
    x = msh.geometry.x
    x[np.all(np.isclose(x, [1, 1, 0]), axis=1), :2] = 0.4
    surface(vector_space(msh))


def in_two_problems(pair):
    kept = pair.problem()
    kept.set_up()
    later = pair.problem()
    later.set_up()
    kept.solve()


def in_another_order(slave):
    if WORLD.size == 1:
        pytest.skip("needs two ranks")
    comm = WORLD.Split(0, -WORLD.rank)
    msh = box(comm, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    qs.Contact(slave, surface(vector_space(msh)))


def in_single_precision():
    corners = [[0.0, 0.0], [1.0, 1.0]]
    surface(vector_space(mesh.create_rectangle(WORLD, corners, [3, 3], dtype=np.float32)))


def with_complex_numbers(V):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PETSc, "ScalarType", np.complex128)
        surface(V)


def displacement_and_velocity(upset):
    other = qs.Contact(upset.upper, upset.tool)
    F = materials.incompressible(upset.w, upset.stress())
    qs.ContactProblem([F], [upset.w], [upset.contacts[0], other])


def pulled_tool():
    upset = Upset()
    upset.tool.drive(-1.0, [0.0, -1.0])
    upset.problem.solve()


def moved_tool():
    upset = Upset()
    upset.tool.advance()
    upset.problem.solve()


def all_held():
    pair = Pair("triangle", penalty="auto")
    for i, bcs in enumerate(pair.bcs):
        bcs.append(clamp(pair.V[i], plane(pair.meshes[i], 1, 0.0)))
    pair.problem().solve()


def pulled_off():
    """A body that is pulled off its support."""
    pair = Pair("triangle")
    pull = ufl.inner(ufl.as_vector([0.0, 1.0]), ufl.TestFunction(pair.V[1])) * ufl.dx
    F = [pair.F[0], pair.F[1] - pull]
    qs.ContactProblem(F, pair.u, [pair.contact], [pair.bcs[0], []]).solve()


def no_vertices(msh):
    u = fem.Function(fem.functionspace(msh, ("DG", 0, (2,))))
    F = ufl.inner(u, ufl.TestFunction(u.function_space)) * ufl.dx
    qs.TimeStepper(qs.ContactProblem([F], [u], []), 0.1)


def several_nodes(msh, folder):
    function = fem.Function(fem.functionspace(msh, ("Lagrange", 3)))
    Checkpoint(WORLD, folder / "a").save({"u": function}, {}, {})


def saved_and_loaded(folder, other):
    upset = Upset()
    upset.stepper.step()
    qs.save_run(upset.stepper, folder)
    qs.load_run(other.stepper, folder)


def stl_without_triangles(filename):
    if WORLD.rank == 0:
        filename.write_text("solid nothing\nendsolid\n", encoding="utf-8")
    WORLD.barrier()
    qs.RigidSurface.from_stl(WORLD, filename)


def off_the_cylinder(surface):
    beside = qs.smooth.Cylinder([0.5, -40.0], None, 30.0)
    qs.elevate(surface.mesh, facets=surface.facets, shape=beside)


def coarse_ring():
    ring = Shell((1, 2), (5.0, 10.0))
    qs.smooth.Cylinder.fit(ring.surface(ring.outer))


def broken_stl(filename, binary, length):
    """A file of two triangles, truncated or with additional data after them."""
    if WORLD.rank == 0:
        corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]])
        write_stl(filename, corners.astype(np.float64), binary)
        data = filename.read_bytes()
        filename.write_bytes((data + data)[:length])
    WORLD.barrier()
    qs.RigidSurface.from_stl(WORLD, filename)


def bodies_on_one_mesh(msh):
    V = [vector_space(msh), vector_space(msh)]
    u = [fem.Function(space) for space in V]
    F = [materials.linear_elastic(w, 1.0, 0.3) for w in u]
    forms = [
        ufl.inner(stress, ufl.grad(ufl.TestFunction(space))) * ufl.dx
        for stress, space in zip(F, V, strict=True)
    ]
    qs.TimeStepper(qs.ContactProblem(forms, u, []), 0.1)


def reduced_integration():
    msh = mesh.create_unit_square(WORLD, 2, 2, mesh.CellType.quadrilateral)
    V = vector_space(msh)
    u, v = fem.Function(V), ufl.TestFunction(V)
    inner = ufl.inner(ufl.grad(u), ufl.grad(v))
    qs.ContactProblem([inner * ufl.dx(degree=3) + inner * ufl.dx(degree=1)], [u], [])


#: Function that provokes each message, from the scene and a folder.
CASES = {
    # Meshes and spaces
    "V: the trace of the space on the facets must be continuous Lagrange of degree 1 or 2": (
        lambda s, folder: on_square(("Lagrange", 3, (2,)))
    ),
    "V: contact needs a blocked vector space with 2 components": (
        lambda s, folder: on_square(("Lagrange", 1, (3,)))
    ),
    "remesh: only bodies in velocities get new meshes": (
        lambda s, folder: new_meshes_of_displacements()
    ),
    'mesher: "mmg" makes tetrahedra; take "gmsh" in 2D': (
        lambda s, folder: qs.remesh(square(), 0.3, mesher="mmg")
    ),
    "body: must be of triangles in 2D, or of tetrahedra in 3D": (
        lambda s, folder: new_mesh(box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0]))
    ),
    "body: the mesh must be of degree 1": lambda s, folder: new_mesh(elevated(square())),
    "mechanics: contact with itself keeps no pairing points": lambda s, folder: field_of_itself(),
    (
        'contacts: a field that is solved for at once with its bodies needs sliding="small"'
    ): lambda s, folder: field_at_once(),
    "V: contact needs mesh geometry of degree 1 or 2, not 3": (
        lambda s, folder: surface(vector_space(elevated(square(), 3)))
    ),
    "V: contact facets of degree 2 are more curved than an arc of 60°": (
        lambda s, folder: ShrinkFit(((1, 2), (2, 2)), degrees=(2, 1))
    ),
    (
        "V: contact needs a mesh of triangles or quadrilaterals in 2D, "
        "of tetrahedra or hexahedra in 3D"
    ): lambda s, folder: prisms(),
    "contact facets are degenerate (zero area, or not convex)": lambda s, folder: not_convex(),
    "of the facets named are not on the boundary of the mesh": (
        lambda s, folder: qs.Surface(s.V, facets=s.interior)
    ),
    "slave and master share facets: a facet cannot be in contact with itself": (
        lambda s, folder: qs.Contact(
            s.pair.slave, qs.Surface(s.pair.slave.V, facets=s.pair.slave.facets)
        )
    ),
    'gives roles to pairs of facets; use "quasi-symmetric"': (
        lambda s, folder: qs.Contact(s.pair.slave, s.pair.slave, formulation="double-pass")
    ),
    "contact of a surface with itself is decided facet by facet": (
        lambda s, folder: qs.Contact(s.pair.slave, s.pair.slave, quadrature="nodal")
    ),
    "contact of a surface with itself cannot be tied": (
        lambda s, folder: qs.Contact(s.pair.slave, s.pair.slave, law=qs.Tied())
    ),
    "slave and master have different geometric dimensions": (
        lambda s, folder: qs.Contact(s.pair.slave, s.of_3d)
    ),
    "the meshes must be on the same ranks in the same order": (
        lambda s, folder: in_another_order(s.pair.slave)
    ),
    "slave and master: both or none must be axisymmetric": lambda s, folder: qs.Contact(
        s.pair.slave, on_square(("Lagrange", 1, (2,)), axisymmetric=True)
    ),
    "V: contact needs a mesh in double precision": lambda s, folder: in_single_precision(),
    "PETSc is complex: contact needs PETSc (petsc4py) with real scalars": (
        lambda s, folder: with_complex_numbers(s.V)
    ),
    "u: every body needs a function space of its own": (
        lambda s, folder: qs.ContactProblem(s.pair.F, [s.pair.u[0]] * 2, [s.pair.contact])
    ),
    # Contact
    (
        "sees nothing of the edges' unknowns of a displacement of degree 2; "
        'use quadrature="overlay"'
    ): lambda s, folder: qs.Contact(
        on_square(("Lagrange", 2, (2,))), s.pair.master, quadrature="nodal"
    ),
    "smoothing: has been removed": (
        lambda s, folder: qs.Contact(s.pair.slave, s.pair.master, smoothing="shared-curvature")
    ),
    "are not on the Cylinder, or too coarse for it": lambda s, folder: coarse_ring(),
    "name the surface that they are on, or take Cylinder.fit": (
        lambda s, folder: off_the_cylinder(s.pair.master)
    ),
    "quadrature: the nodal rule measures gaps to straight facets": (
        lambda s, folder: ShrinkFit(((16, 5), (22, 7)), degrees=(2, 1), quadrature="nodal")
    ),
    "formulation: double-pass needs a multiplier on both sides, and a rigid tool has none": (
        lambda s, folder: qs.Contact(s.pair.slave, s.case.tool, formulation="double-pass")
    ),
    "enforcement: the multipliers of double-pass contact, on both sides, cannot close every gap": (
        lambda s, folder: qs.Contact(
            s.pair.slave,
            s.pair.master,
            formulation="double-pass",
            enforcement="augmented-lagrangian",
        )
    ),
    "slave: must be a qsdolfinx.Surface; a rigid tool can be the master only": (
        lambda s, folder: qs.Contact(s.case.tool, s.pair.slave)
    ),
    'constraints: "points" needs quadrature="overlay"': (
        lambda s, folder: qs.Contact(
            s.pair.slave, s.pair.master, quadrature="nodal", constraints="points"
        )
    ),
    'constraints: sliding: "finite" asks the law at points': (
        lambda s, folder: qs.Contact(
            s.pair.slave, s.pair.master, sliding="finite", constraints="nodes"
        )
    ),
    'constraints: tied contact is over-constrained at "points"; use "nodes"': (
        lambda s, folder: qs.Contact(
            s.pair.slave, s.pair.master, law=qs.Tied(), quadrature="overlay", constraints="points"
        )
    ),
    "friction: tied contact sticks already; leave it out, or use Unilateral()": (
        lambda s, folder: qs.Contact(
            s.pair.slave, s.pair.master, law=qs.Tied(), friction=qs.Coulomb(0.1)
        )
    ),
    "law: must be qs.Tied() or qs.Unilateral()": (
        lambda s, folder: qs.Contact(s.pair.slave, s.pair.master, law="adhesion")
    ),
    "contacts: one of them is in the list twice": lambda s, folder: qs.ContactProblem(
        s.pair.F, s.pair.u, [s.pair.contact] * 2, s.pair.bcs
    ),
    "contacts: contact 0 is part of another problem": lambda s, folder: in_two_problems(s.pair),
    "contacts: must agree on whether u[0] is a velocity, and on dt": (
        lambda s, folder: displacement_and_velocity(s.case)
    ),
    "force: a negative one pulls the tool, which needs tied contact": (
        lambda s, folder: pulled_tool()
    ),
    "the tool has been moved for good: call contact.update()": lambda s, folder: moved_tool(),
    'penalty: "auto" needs unknowns without Dirichlet conditions and with stiffness': (
        lambda s, folder: all_held()
    ),
    "the Function must be on the mesh of the slave": lambda s, folder: qs.Contact(
        s.pair.slave, s.pair.master, friction=qs.Coulomb(s.on_other_mesh)
    ),
    'enforcement: a law that remembers uses gap and ε only; use "penalty"': (
        lambda s, folder: bonded(s, enforcement="augmented-lagrangian")
    ),
    "penalty: a law that remembers needs a number, as ε is a part of it": (
        lambda s, folder: bonded(s, penalty="auto")
    ),
    "friction: its memory and that of the law need other names": (
        lambda s, folder: bonded(s, friction=weakening_by_damage())
    ),
    # Solvers and materials
    "SNES did not converge: DIVERGED_": lambda s, folder: pulled_off(),
    'kind: linear_solver="amg" needs kind="mpi"; use "fieldsplit"': (
        lambda s, folder: s.pair.problem(solver="amg", kind="nest")
    ),
    'solver: "schur" needs a body in velocity and pressure': (
        lambda s, folder: s.pair.problem(solver="schur")
    ),
    'solver: "schur" eliminates unknowns inside cells, and F[0] has integrals': (
        lambda s, folder: jumps_of_a_mini_body()
    ),
    "has integrals with one quadrature point and others over the same cells": (
        lambda s, folder: reduced_integration()
    ),
    "nu: must be above -1 and below 0.5, not 0.5": (
        lambda s, folder: materials.linear_elastic(s.pair.u[0], 1.0, 0.5)
    ),
    "m: must be a positive, finite number, not 0": (
        lambda s, folder: materials.norton_hoff(s.pair.u[0], 1.0, 0, 1e-3)
    ),
    "regularisation: must be a positive, finite number, not 0": (
        lambda s, folder: materials.norton_hoff(s.pair.u[0], 1.0, 0.2, 0)
    ),
    "msh: the MINI element needs triangles in 2D or tetrahedra in 3D": (
        lambda s, folder: materials.mini_space(s.quads)
    ),
    # Time steps and files
    "the mesh of u[0] is distorted": (
        lambda s, folder: list(Upset(n=2, dt=0.1, min_quality=0.3).stepper.run(0.95))
    ),
    "no step with Δt of at least dt_min": lambda s, folder: Upset(
        dt=0.04, dt_min=0.02, solve=lambda step: refuse()
    ).stepper.step(),
    "u: has no displacement or velocity with unknowns at the vertices": (
        lambda s, folder: no_vertices(s.case.mesh)
    ),
    "a checkpoint holds functions with one node per vertex, edge, face or cell": (
        lambda s, folder: several_nodes(s.case.mesh, folder)
    ),
    "is of another mesh or space": lambda s, folder: saved_and_loaded(folder / "b", Upset(n=4)),
    "is of other contacts or tools": (
        lambda s, folder: saved_and_loaded(folder / "c", Upset(die=True))
    ),
    "filename: must end in .xdmf, .pvd, .bp or .vtkhdf": (
        lambda s, folder: qs.FieldWriter(folder / "a.vtu", s.case.mesh, {})
    ),
    "filename: there is no folder": (
        lambda s, folder: qs.FieldWriter(folder / "none" / "a.xdmf", s.case.mesh, {})
    ),
    "is truncated, or no STL file": lambda s, folder: broken_stl(folder / "d.stl", False, 300),
    "has more than its header says": lambda s, folder: broken_stl(folder / "e.stl", True, 300),
    "u[0] and u[1] are on one mesh, which time steps move with each of them": (
        lambda s, folder: bodies_on_one_mesh(s.case.mesh)
    ),
    "is no STL file with triangles": lambda s, folder: stl_without_triangles(folder / "a.stl"),
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("limits")), root=0)
    scene = Scene(pathlib.Path(folder))
    yield scene
    scene.close()


def test_the_page_lists_what_is_tested():
    assert sorted(messages()) == sorted(CASES)


@pytest.mark.parametrize("message", CASES)
def test_refused(scene, message):
    error = (ValueError, TypeError, OSError, RuntimeError)
    before = scene.state()
    raises_everywhere(WORLD, error, message, lambda: CASES[message](scene, scene.folder))
    assert scene.is_as(before)
