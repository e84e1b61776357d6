"""docs/limits.md: everything that it says is refused is, with the message that it prints."""

import pathlib
import re

from petsc4py import PETSc

import numpy as np
import pytest
from base.malformed_scene import Scene
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    curved_triangle,
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

#: By the message: what makes it, from the scene and a folder.
CASES = {}


def case(message):
    def add(function):
        CASES[message] = function
        return function

    return add


def messages():
    """Those of the page's tables."""
    return re.findall(r"^\| .* \| `(.*)` \|$", PAGE.read_text(), re.M)


# --- Meshes and spaces


def surface(V, **more):
    msh = V.mesh
    axis = msh.geometry.dim - 1
    return qs.Surface(V, facets=plane(msh, axis, 0.0), **more)


def on_square(element, cell="triangle", **more):
    msh = box(WORLD, (3, 3), cell, [0.0, 0.0], [1.0, 1.0])
    return surface(fem.functionspace(msh, element), **more)


@case("V: the trace of the space on the facets must be continuous Lagrange of degree 1 or 2")
def cubic(scene, folder):
    on_square(("Lagrange", 3, (2,)))


@case("V: contact needs a blocked vector space with 2 components")
def scalar(scene, folder):
    on_square(("Lagrange", 1))


@case("V: contact facets must be straight-sided: mesh geometry of degree 1")
def curved(scene, folder):
    surface(vector_space(curved_triangle()))


@case(
    "V: contact needs a mesh of triangles or quadrilaterals in 2D, of tetrahedra or hexahedra in 3D"
)
def prisms(scene, folder):
    corners = [[0.0] * 3, [1.0] * 3]
    msh = mesh.create_box(WORLD, corners, [2, 2, 2], mesh.CellType.prism)
    qs.Surface(vector_space(msh), facets=np.zeros(0, dtype=np.int32))


@case("contact facets are degenerate (zero area, or not convex)")
def not_convex(scene, folder):
    msh = box(WORLD, [1, 1, 1], "hexahedron", [0, 0, 0], [1, 1, 1])
    x = msh.geometry.x
    x[np.all(np.isclose(x, [1, 1, 0]), axis=1), :2] = 0.4
    surface(vector_space(msh))


@case("of the facets named are not on the boundary of the mesh")
def interior(scene, folder):
    qs.Surface(scene.V, facets=scene.interior)


@case("slave and master share facets: a facet cannot be in contact with itself")
def itself(scene, folder):
    qs.Contact(scene.pair.slave, scene.pair.slave)


@case("slave and master have different geometric dimensions")
def dimensions(scene, folder):
    qs.Contact(scene.pair.slave, scene.of_3d)


@case("the meshes must be on the same ranks in the same order")
def ranks(scene, folder):
    if WORLD.size == 1:
        pytest.skip("needs two ranks")
    comm = WORLD.Split(0, -WORLD.rank)
    msh = box(comm, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    qs.Contact(scene.pair.slave, surface(vector_space(msh)))


@case("slave and master: both or none must be axisymmetric")
def axisymmetric(scene, folder):
    qs.Contact(scene.pair.slave, on_square(("Lagrange", 1, (2,)), axisymmetric=True))


@case("V: contact needs a mesh in double precision")
def single(scene, folder):
    corners = [[0.0, 0.0], [1.0, 1.0]]
    msh = mesh.create_rectangle(WORLD, corners, [3, 3], dtype=np.float32)
    surface(vector_space(msh))


@case("PETSc is complex: contact needs PETSc (petsc4py) with real scalars")
def complex_numbers(scene, folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PETSc, "ScalarType", np.complex128)
        surface(scene.V)


@case("u: every body needs a function space of its own")
def shared_space(scene, folder):
    pair = scene.pair
    qs.ContactProblem(pair.F, [pair.u[0], pair.u[0]], [pair.contact])


# --- Contact


@case(
    'sees nothing of the edges\' unknowns of a displacement of degree 2; use quadrature="overlay"'
)
def nodal_quadratic(scene, folder):
    qs.Contact(on_square(("Lagrange", 2, (2,))), scene.pair.master)


@case("formulation: double-pass needs a multiplier on both sides, and a rigid tool has none")
def double_pass_on_tool(scene, folder):
    qs.Contact(scene.pair.slave, scene.case.tool, "double-pass")


@case("slave: must be a qsdolfinx.Surface; a rigid tool can be the master only")
def tool_as_slave(scene, folder):
    qs.Contact(scene.case.tool, scene.pair.slave)


@case("friction: tied contact sticks already; leave it out, or use Unilateral()")
def tied_friction(scene, folder):
    qs.Contact(scene.pair.slave, scene.pair.master, law=qs.Tied(), friction=qs.Coulomb(0.1))


@case("law: must be qs.Tied() or qs.Unilateral()")
def law_by_name(scene, folder):
    qs.Contact(scene.pair.slave, scene.pair.master, law="adhesion")


@case("contacts: one of them is in the list twice")
def twice(scene, folder):
    qs.ContactProblem(scene.pair.F, scene.pair.u, [scene.pair.contact] * 2, scene.pair.bcs)


@case("contacts: must agree on whether u[0] is a velocity, and on dt")
def two_kinds(scene, folder):
    upset = scene.case
    other = qs.Contact(upset.upper, upset.tool)
    F = materials.incompressible(upset.w, upset.stress())
    qs.ContactProblem([F], [upset.w], [upset.contacts[0], other])


@case("force: a negative one pulls the tool, which needs tied contact")
def pulled(scene, folder):
    upset = Upset()
    upset.tool.drive(-1.0, [0.0, -1.0])
    upset.problem.solve()


@case("the tool has been moved for good: call contact.update()")
def moved(scene, folder):
    upset = Upset()
    upset.tool.advance()
    upset.problem.solve()


@case('penalty: "auto" needs unknowns without Dirichlet conditions and with stiffness')
def all_held(scene, folder):
    pair = Pair("triangle", penalty="auto")
    for i, bcs in enumerate(pair.bcs):
        bcs.append(clamp(pair.V[i], plane(pair.meshes[i], 1, 0.0)))
    pair.problem().solve()


@case("the Function must be on the mesh of the slave")
def parameter(scene, folder):
    qs.Contact(scene.pair.slave, scene.pair.master, friction=qs.Coulomb(scene.on_other_mesh))


# --- Solvers and materials


@case("SNES did not converge: DIVERGED_")
def not_balanced(scene, folder):
    """A body that is pulled off its support."""
    pair = Pair("triangle")
    pull = ufl.inner(ufl.as_vector([0.0, 1.0]), ufl.TestFunction(pair.V[1])) * ufl.dx
    F = [pair.F[0], pair.F[1] - pull]
    qs.ContactProblem(F, pair.u, [pair.contact], [pair.bcs[0], []]).solve()


@case("enforcement: the multipliers of double-pass contact, on both sides, cannot close every gap")
def two_multipliers(scene, folder):
    Pair("triangle", "double-pass", contact_options={"enforcement": "augmented-lagrangian"})


@case('kind: solver="amg" needs kind="mpi"; use "fieldsplit"')
def amg_nest(scene, folder):
    scene.pair.problem(solver="amg", kind="nest")


@case('solver: "schur" needs a body in velocity and pressure')
def schur(scene, folder):
    scene.pair.problem(solver="schur")


@case("nu: must be above -1 and below 0.5, not 0.5")
def incompressible(scene, folder):
    materials.linear_elastic(scene.pair.u[0], 1.0, 0.5)


@case("m: must be a positive, finite number, not 0")
def rigid_plastic(scene, folder):
    materials.norton_hoff(scene.pair.u[0], 1.0, 0, 1e-3)


@case("regularisation: must be a positive, finite number, not 0")
def no_regularisation(scene, folder):
    materials.norton_hoff(scene.pair.u[0], 1.0, 0.2, 0)


@case("msh: the MINI element needs triangles in 2D or tetrahedra in 3D")
def mini(scene, folder):
    materials.mini_space(scene.quads)


# --- Time steps and files


@case("the mesh of u[0] is distorted")
def flat(scene, folder):
    list(Upset(n=2, dt=0.1, min_quality=0.3).stepper.run(0.95))


@case("no step with Δt of at least dt_min")
def smallest(scene, folder):
    Upset(dt=0.04, dt_min=0.02, solve=lambda step: refuse()).stepper.step()


@case("u: has no displacement or velocity with unknowns at the vertices")
def no_vertices(scene, folder):
    V = fem.functionspace(scene.case.mesh, ("DG", 0, (2,)))
    u = fem.Function(V)
    F = ufl.inner(u, ufl.TestFunction(V)) * ufl.dx
    qs.TimeStepper(qs.ContactProblem([F], [u], []), 0.1)


@case("a checkpoint holds functions with one node per vertex, edge, face or cell")
def several_nodes(scene, folder):
    function = fem.Function(fem.functionspace(scene.case.mesh, ("Lagrange", 3)))
    Checkpoint(WORLD, folder / "a").save({"u": function}, {}, {})


@case("is of another mesh or space")
def other_mesh(scene, folder):
    upset = Upset()
    upset.stepper.step()
    qs.save_run(upset.stepper, folder / "b")
    qs.load_run(Upset(n=4).stepper, folder / "b")


@case("is of other contacts or tools")
def other_contacts(scene, folder):
    upset = Upset()
    qs.save_run(upset.stepper, folder / "c")
    qs.load_run(Upset(die=True).stepper, folder / "c")


@case("filename: must end in .xdmf or .bp")
def other_format(scene, folder):
    qs.FieldWriter(folder / "a.vtu", scene.case.mesh, {})


@case("filename: there is no folder")
def missing_folder(scene, folder):
    qs.FieldWriter(folder / "none" / "a.xdmf", scene.case.mesh, {})


@case("is no STL file with triangles")
def no_stl(scene, folder):
    if WORLD.rank == 0:
        (folder / "a.stl").write_text("solid nothing\nendsolid\n")
    WORLD.barrier()
    qs.RigidSurface.from_stl(WORLD, folder / "a.stl")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("limits")), root=0)
    scene = Scene(pathlib.Path(folder))
    yield scene
    scene.close()


def test_the_page_lists_what_is_tested():
    assert sorted(messages()) == sorted(CASES)


@pytest.mark.parametrize("message", CASES, ids=[f.__name__ for f in CASES.values()])
def test_refused(scene, message):
    error = (ValueError, TypeError, OSError, RuntimeError)
    before = scene.state()
    raises_everywhere(WORLD, error, message, lambda: CASES[message](scene, scene.folder))
    assert scene.is_as(before)
