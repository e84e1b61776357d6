"""ContactProblem: several bodies and contacts, nonlinear and mixed forms, penalty, moved meshes."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    create_mesh,
    elastic,
    elastic_form,
    largest,
    mini_space,
    plane,
    slide,
    vector_space,
)

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


@pytest.mark.parallel
def test_three_bodies_in_a_row():
    """The middle body is slave of one contact and master of another; forces are transmitted."""
    meshes = [
        box(WORLD, [n, 2], "quadrilateral", [0, i], [1, i + 1]) for i, n in enumerate((3, 5, 4))
    ]
    V = [vector_space(m) for m in meshes]
    u = [fem.Function(space) for space in V]
    F = [elastic(f, E=10.0, nu=0.0) for f in u]
    bcs = [
        [clamp(V[0], plane(meshes[0], 1, 0.0))],
        [],
        [clamp(V[2], plane(meshes[2], 1, 3.0), [0, -0.3])],
    ]
    bcs[1].append(slide(V[1], 0, plane(meshes[1], 0, 0.0)))
    low = qs.Contact(
        qs.Surface(V[1], facets=plane(meshes[1], 1, 1.0)),
        qs.Surface(V[0], facets=plane(meshes[0], 1, 1.0)),
        penalty=1e6,
    )
    high = qs.Contact(
        qs.Surface(V[2], facets=plane(meshes[2], 1, 2.0)),
        qs.Surface(V[1], facets=plane(meshes[1], 1, 2.0)),
        law=qs.Tied(),
        penalty=1e6,
    )
    problem = qs.ContactProblem(F, u, [low, high], bcs)
    solution = problem.solve()
    forces = [low.force("master"), low.force("slave"), high.force("master"), high.force("slave")]
    coupled = [[problem.blocks.block(i, j) is not None for j in range(3)] for i in range(3)]
    # Uniaxial, except at the clamps: E × strain × width within a few percent.
    assert solution == u
    assert np.isclose(forces[3][1], 10 * 0.1, rtol=0.02)
    for f in forces[1:3]:
        assert abs(abs(f[1]) - forces[3][1]) < 1e-9
    np.testing.assert_allclose(forces[0], -forces[1], atol=1e-12)
    assert coupled == [[True, True, False], [True, True, True], [False, True, True]]


def test_two_contacts_of_the_same_bodies():
    """A surface that is split into two contacts acts as one master-slave contact does."""
    options = {"quadrature": "nodal", "enforcement": "penalty"}
    given = {"n": (4, 8), "penalty": 100.0, "contact_options": options}
    whole = Pair("quadrilateral", "master-slave", qs.Tied(), **given)
    whole.problem().solve()
    parts = Pair("quadrilateral", "master-slave", qs.Tied(), **given)
    V, msh = parts.V[1], parts.meshes[1]
    facets = plane(msh, 1, 0.0)
    msh.topology.create_connectivity(1, 0)
    left = mesh.compute_midpoints(msh, 1, facets)[:, 0] < 0.5
    contacts = [
        qs.Contact(
            qs.Surface(V, facets=f),
            parts.master,
            formulation="master-slave",
            law=qs.Tied(),
            penalty=100.0,
            **options,
        )
        for f in (facets[left], facets[~left])
    ]
    qs.ContactProblem(parts.F, parts.u, contacts, parts.bcs).solve()
    # Nodal areas add up at the node that both contacts share.
    errors = [largest(a.x.array - b.x.array) for a, b in zip(whole.u, parts.u, strict=True)]
    assert max(errors) < 1e-12


def test_contact_within_one_mesh():
    """Both surfaces of a contact may belong to one body: two blocks of one mesh and one space."""
    lattice = np.array([[x, y] for y in (0, 0.5, 1) for x in (0, 0.5, 1)])
    points = np.concatenate([lattice, lattice + np.array([0, 1])])
    quads = np.array([[i, i + 1, i + 3, i + 4] for i in (0, 1, 3, 4)])
    cells = np.concatenate([quads, quads + 9])
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    mine = slice(None) if WORLD.rank == 0 else slice(0)
    msh = create_mesh(cells[mine], points[mine], ufl.Mesh(element))
    V = vector_space(msh)
    u = fem.Function(V)
    inner = plane(msh, 1, 1.0)
    msh.topology.create_connectivity(1, 2)
    to_cell = msh.topology.connectivity(1, 2)
    cell_of = np.array([to_cell.links(f)[0] for f in inner], dtype=np.int32)
    upper = mesh.compute_midpoints(msh, 2, cell_of)[:, 1] > 1
    slave = qs.Surface(V, facets=inner[upper])
    master = qs.Surface(V, facets=inner[~upper])
    contact = qs.Contact(slave, master, penalty=1e6)
    bcs = [clamp(V, plane(msh, 1, 0.0)), clamp(V, plane(msh, 1, 2.0), [0.0, -0.2])]
    problem = qs.ContactProblem([elastic(u, E=10.0, nu=0.0)], [u], [contact], [bcs])
    problem.solve()
    forces = contact.force("slave"), contact.force("master")
    np.testing.assert_allclose(forces[0], [0, 1.0], atol=1e-4)
    np.testing.assert_allclose(forces[1], -forces[0], atol=1e-13)


def hyperelastic(u, mu=1.0, lmbda=1.0):
    """Residual of a compressible neo-Hookean material."""
    F = ufl.variable(ufl.Identity(u.ufl_shape[0]) + ufl.grad(u))
    J = ufl.det(F)
    energy = (
        mu / 2 * (ufl.tr(F.T * F) - u.ufl_shape[0]) - mu * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2
    )
    return ufl.inner(ufl.diff(energy, F), ufl.grad(ufl.TestFunction(u.function_space))) * ufl.dx


@pytest.mark.parametrize("load", (-0.1, 0.1))
def test_nonlinear_body(load):
    """A neo-Hookean body on a linear body converges with Newton's method and lifted conditions."""
    pair = Pair("tetrahedron", "quasi-symmetric", qs.Tied(), n=(3, 2), load=load)
    pair.F[1] = hyperelastic(pair.u[1])
    problem = pair.problem()
    problem.solve()
    iterations, history = problem.snes.getIterationNumber(), problem.residual_history
    linear = [body.linear for body in problem.bodies]
    forces = pair.contact.force("slave"), pair.contact.force("master")
    top = largest(pair.u[1].x.array)

    # With an approximate tangent the solution is the same.
    other = Pair("tetrahedron", "quasi-symmetric", qs.Tied(), n=(3, 2), load=load)
    other.F[1] = hyperelastic(other.u[1])
    J = elastic_form(ufl.TrialFunction(other.V[1]), ufl.TestFunction(other.V[1]), E=2.5, nu=0.25)
    slow = other.problem(J=[None, J], petsc_options={"snes_max_it": 200})
    slow.solve()
    error = largest(other.u[1].x.array - pair.u[1].x.array)
    slow_iterations = slow.snes.getIterationNumber()

    assert linear == [True, False]
    assert iterations <= 6
    assert history[-1] < 1e-8 * history[0]
    np.testing.assert_allclose(forces[0], -forces[1], atol=1e-12)
    assert forces[0][2] * load < 0
    assert np.isclose(top, abs(load))  # the load is applied
    assert slow_iterations > iterations
    assert error < 1e-7


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
def test_mixed_space(law):
    """A surface in a sub-space of displacement and pressure has contact with a body in plain P1.

    The element has a bubble (MINI) and the material is nearly incompressible. Forces balance, and
    the boundary conditions hold.
    """
    pair = Pair("triangle", law=law(), n=(6, 5))
    msh, gdim = pair.meshes[1], 2
    element = basix.ufl.mixed_element(
        [mini_space(msh).ufl_element(), basix.ufl.element("Lagrange", msh.basix_cell(), 1)]
    )
    W = fem.functionspace(msh, element)
    w = fem.Function(W)
    u, p = ufl.split(w)
    v, q = ufl.split(ufl.TestFunction(W))
    strain = ufl.sym(ufl.grad(u))
    F = (
        2 * ufl.inner(strain, ufl.grad(v)) - p * ufl.div(v) - q * ufl.div(u) - 1e-4 * p * q
    ) * ufl.dx
    V, _ = W.sub(0).sub(1).collapse()
    top = plane(msh, 1, 1.0)
    down = fem.Function(V)
    down.x.array[:] = -0.1
    zero = fem.Function(V)
    bcs = []
    for i, value in ((0, zero), (1, down)):
        Vi = W.sub(0).sub(i).collapse()[0]
        g = fem.Function(Vi)
        g.x.array[:] = value.x.array[:1] if len(value.x.array) else 0.0
        dofs = fem.locate_dofs_topological((W.sub(0).sub(i), Vi), 1, top)
        bcs.append(fem.dirichletbc(g, dofs, W.sub(0).sub(i)))
    surface = qs.Surface(W.sub(0), facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, pair.master, law=law(), penalty=100.0)
    problem = qs.ContactProblem([pair.F[0], F], [pair.u[0], w], [contact], [pair.bcs[0], bcs])
    problem.solve()
    forces = contact.force("slave"), contact.force("master")
    traction = contact.traction("slave")
    dim = traction.function_space.mesh.geometry.dim
    ds = ufl.Measure("ds", domain=msh)
    total = WORLD.allreduce(fem.assemble_scalar(fem.form(traction[1] * ds)))
    held = problem.system.made.rigid.free_motions.shape[1] == 0
    assert dim == gdim and held
    np.testing.assert_allclose(forces[0], -forces[1], atol=1e-12)
    assert forces[0][1] > 0.01
    # t_k S_k = f_k: the integral of the traction is the force (off the surface the traction is
    # zero).
    assert total > 0.9 * forces[0][1]


def test_automatic_penalty():
    """The penalty ε from the softer body's stiffness scales with E and 1/h, on any partition."""

    def penalty(n, comm=WORLD, scale=1.0):
        pair = Pair("hexahedron", n=n, penalty="auto", comm=comm)
        pair.F = [elastic(u, E=scale * (1.0 + i)) for i, u in enumerate(pair.u)]
        before = pair.contact.penalty
        pair.problem().set_up()
        return before, pair.contact.penalty

    before, coarse = penalty((4, 4))
    _, serial = penalty((4, 4), MPI.COMM_SELF)
    _, stiff = penalty((4, 4), scale=10.0)
    _, fine = penalty((8, 8))
    assert before is None
    assert np.isclose(coarse, serial, rtol=1e-12)
    assert np.isclose(stiff, 10 * coarse, rtol=1e-12)
    assert 1.2 * coarse < fine < 4 * coarse
    assert 4 < coarse < 1e4  # E/h is 4


def test_automatic_penalty_stays():
    """The automatic penalty is computed once: a moved mesh does not change it."""
    pair = Pair("quadrilateral", penalty="auto")
    problem = pair.problem()
    problem.solve()
    first = pair.contact.penalty
    for msh in pair.meshes:
        msh.geometry.x[:] *= 2
    pair.contact.update()
    problem.solve()
    assert pair.contact.penalty == first


def test_penalty_can_be_changed():
    pair = Pair("triangle", penalty=10.0, contact_options={"enforcement": "penalty"})
    problem = pair.problem()
    gaps = []
    for penalty in (10.0, 1000.0):
        pair.contact.set_penalty(penalty)
        problem.solve()
        gaps.append(largest(np.maximum(np.nan_to_num(pair.contact.weighted_gap()), 0)))
    assert gaps[1] < gaps[0] / 20


def test_moved_meshes_are_paired_anew():
    """update() after a motion gives a new pattern and new gaps in the same problem object."""
    pair = Pair("quadrilateral", n=(7, 5), load=-0.05)
    problem = pair.problem()
    problem.solve()
    first = pair.contact.force("slave")
    pair.meshes[1].geometry.x[:, 0] += 0.1
    pair.contact.update()
    problem.solve()
    second = pair.contact.force("slave")
    pair.meshes[1].geometry.x[:, 0] -= 0.1
    pair.contact.update()
    problem.solve()
    third = pair.contact.force("slave")
    assert second[1] < first[1]
    np.testing.assert_allclose(third, first, atol=1e-12)


def test_no_contacts_is_plain_elasticity():
    pair = Pair("tetrahedron", load=0.1)
    problem = qs.ContactProblem(pair.F, pair.u, [], pair.bcs)
    problem.solve()
    iterations = problem.snes.getIterationNumber()
    residual = fem.assemble_vector(fem.form(pair.F[0]))
    assert iterations <= 2  # the body moves rigidly: only rounding remains
    assert largest(residual.array) < 1e-12
