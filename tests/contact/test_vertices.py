"""Vertices at sharp edges: no corner penetrates another surface without a contact force."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, box, elastic, largest, plane, vector_space

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import apply_lifting, assemble_matrix, create_vector, set_bc

import qsdolfinx as qs

E, N = 1e3, 6
POINTS = {"constraints": "points", "enforcement": "augmented-lagrangian"}


def rotation(case):
    """Return a rotation of the unit square or cube that puts a corner, or the edge along y, lowest.

    The lowest point is at 0.
    """
    if case == "corner":
        up = np.ones(3) / np.sqrt(3)
        along = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
        return np.array([along, np.cross(up, along), up])
    s = np.sqrt(0.5)
    if case == "square":
        return s * np.array([[1.0, -1.0], [1.0, 1.0]])
    return np.array([[s, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, s]])


class Standing:
    """Square or cube on its corner or edge, held by the sides away from it."""

    def __init__(self, case, cell, degree=1):
        self.R, self.n = rotation(case), N if case == "square" else 4
        d = self.d = len(self.R)
        self.msh = box(WORLD, (self.n,) * d, cell, [0.0] * d, [1.0] * d)
        self.msh.geometry.x[:, :d] = self.msh.geometry.x[:, :d] @ self.R.T
        across = [1] if case == "edge" else []
        self.axes = [k for k in range(d) if k not in across]
        self.V = fem.functionspace(self.msh, ("Lagrange", degree, (d,)))
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E=E, nu=0.3)
        self.far = self.facets(1.0)
        held = fem.locate_dofs_topological(self.V, d - 1, self.far)
        self.bcs = [fem.dirichletbc(np.zeros(d), held, self.V)]

    def facets(self, at):
        def found(x):
            local = self.R.T @ x[: self.d]
            return np.any([np.isclose(local[k], at) for k in self.axes], axis=0)

        return mesh.locate_entities_boundary(self.msh, self.d - 1, found)

    def surface(self):
        return qs.Surface(self.V, facets=self.facets(0.0))

    def force_by_conditions(self, depth):
        """Return the force to lift the lowest nodes by a depth: a linear problem, no contact."""
        dim = 0 if len(self.axes) == self.d else 1
        self.msh.topology.create_connectivity(dim, self.d)
        lowest = mesh.locate_entities_boundary(
            self.msh, dim, lambda x: np.isclose(self.R.T[self.axes] @ x[: self.d], 0).all(axis=0)
        )
        up = self.V.sub(self.d - 1)
        lifted = fem.locate_dofs_topological(up, dim, lowest)
        bcs = [fem.dirichletbc(depth, lifted, up), *self.bcs]
        J = fem.form(ufl.derivative(self.F, self.u))
        A, free = assemble_matrix(J, bcs=bcs), assemble_matrix(J)
        b = create_vector(fem.form(self.F))
        apply_lifting(b, [J], [bcs])
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        set_bc(b, bcs)
        ksp = PETSc.KSP().create(WORLD)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        for mat in (A, free):
            mat.assemble()
        ksp.setOperators(A)
        x, reaction = A.createVecRight(), A.createVecLeft()
        ksp.solve(b, x)
        free.mult(x, reaction)
        own = lifted[lifted < reaction.local_size]
        return WORLD.allreduce(float(reaction.array_r[own].sum()))


CASES = (
    ("square", "quadrilateral"),
    ("square", "triangle"),
    ("edge", "hexahedron"),
    ("edge", "tetrahedron"),
    ("corner", "hexahedron"),
)


@pytest.mark.parametrize("depth", (0.01, 0.2))
@pytest.mark.parametrize(("case", "cell"), CASES)
def test_on_a_plane(case, cell, depth):
    """From first contact on, the force is that of Dirichlet conditions that lift the vertices."""
    body = Standing(case, cell)
    depth /= body.n
    normal = np.eye(body.d)[-1]
    tool = qs.RigidSurface.plane(WORLD, np.zeros(body.d), normal)
    contact = qs.Contact(body.surface(), tool, **POINTS)
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    tool.displacement = depth * normal
    problem.solve()
    assert problem.num_iterations <= 4
    force = contact.force("slave")
    expected = body.force_by_conditions(depth)
    np.testing.assert_allclose(force[-1], expected, rtol=1e-9)
    assert largest(force[:-1]) < 1e-9 * expected  # the plane is level
    assert contact.penetration() < 1e-9 / body.n
    lowest = np.isclose(contact.slave.node_x[:, body.d - 1], 0.0)
    np.testing.assert_array_equal(contact.active()[lowest], True)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize(("case", "cell"), (CASES[0], CASES[2], CASES[4]))
def test_roles_do_not_matter(case, cell, enforcement):
    """On a block of equal stiffness, the force does not depend on which body is the slave."""
    forces = []
    for swapped in (False, True):
        body, d = Standing(case, cell), len(rotation(case))
        depth, low, high = 0.1 / body.n, [-0.7] * (d - 1) + [-0.5], [0.7] * (d - 1) + [0.0]
        if case == "edge":  # so that the edge does not cross the rim
            low[1], high[1] = -0.2, 1.2
        msh = box(WORLD, (7,) * (d - 1) + (4,), cell, low, high)
        V = vector_space(msh)
        u = fem.Function(V)
        bottom = fem.locate_dofs_topological(V, d - 1, plane(msh, d - 1, -0.5))
        lift = fem.dirichletbc(depth * np.eye(d)[-1], bottom, V)
        surfaces = [body.surface(), qs.Surface(V, facets=plane(msh, d - 1, 0.0))]
        options = POINTS | {"enforcement": enforcement, "penalty": 20 * E}
        contact = qs.Contact(*surfaces[:: -1 if swapped else 1], **options)
        forms, unknowns = [body.F, elastic(u, E=E, nu=0.3)], [body.u, u]
        problem = qs.ContactProblem(forms, unknowns, [contact], [body.bcs, [lift]])
        problem.solve()
        forces.append(contact.force("master" if swapped else "slave")[-1])
        if enforcement == "augmented-lagrangian":
            assert contact.penetration() < 0.005 / body.n
    assert forces[0] > 0
    rtol = 1e-9 if enforcement == "augmented-lagrangian" else 0.1  # the slave's areas are weights
    np.testing.assert_allclose(*forces, rtol=rtol)


def test_pressed_flat():
    """A cube flat on a plane: its corners get no constraints, and the patch test is exact."""
    msh = box(WORLD, (3, 3, 3), "hexahedron", [0.0] * 3, [1.0] * 3)
    V = vector_space(msh)
    u = fem.Function(V)
    facets = np.unique(np.concatenate([plane(msh, k, 0.0) for k in range(3)]))
    walls = [
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(k), 2, plane(msh, k, 0.0)), V.sub(k))
        for k in range(2)
    ]
    top = fem.locate_dofs_topological(V.sub(2), 2, plane(msh, 2, 1.0))
    press = fem.dirichletbc(-0.01, top, V.sub(2))
    tool = qs.RigidSurface.plane(WORLD, [0.0] * 3, [0.0, 0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=facets), tool, **POINTS)
    problem = qs.ContactProblem([elastic(u, E=E)], [u], [contact], [[*walls, press]])
    problem.solve()
    pressure = contact.slave.linear.node_values(contact.traction("slave"))
    flat = np.isclose(contact.slave.node_x[:, 2], 0) & (contact.slave.node_x[:, :2] > 0.1).all(1)
    np.testing.assert_allclose(pressure[flat, 2], 10.0, rtol=1e-9)
    np.testing.assert_allclose(contact.force("slave")[2], 10.0, rtol=1e-9)


def test_friction():
    """A slipping corner has Coulomb's friction, in steps that update the contact pairs."""
    body = Standing("square", "quadrilateral")
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = POINTS | {"sliding": "small"}
    contact = qs.Contact(body.surface(), tool, friction=qs.Coulomb(0.3), **options)
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    depth = 0.1 / body.n

    def drive(t, dt):
        tool.displacement = [depth * dt, depth * dt if t < 1.5 else 0.0]

    work = 0.0
    for t in qs.TimeStepper(problem, 1.0, drive).run(4.0):
        force = contact.force("slave")
        np.testing.assert_allclose(force[0], 0.3 * force[1], rtol=1e-9)
        work += contact.step_dissipation() if t > 2.5 else 0.0
        at_nodes = WORLD.allreduce(float(contact.dissipation().sum()))
        assert at_nodes == pytest.approx(contact.step_dissipation(), rel=1e-12)
        assert problem.num_iterations <= 4
        assert WORLD.allreduce(int(contact.slipping().sum())) == 1
    # In the last two steps only the place of the tool changes.
    np.testing.assert_allclose(work, force[0] * 2 * depth, rtol=1e-9)


@pytest.mark.parametrize("swapped", (False, True))
def test_heat(swapped):
    """Insulated bodies keep the frictional heat of a corner, whichever body has the corner."""
    body = Standing("square", "triangle")
    depth, low = 0.1 / body.n, box(WORLD, (9, 4), "triangle", [-0.7, -0.5], [0.7, 0.0])
    V = vector_space(low)
    u = fem.Function(V)
    bottom = fem.locate_dofs_topological(V, 1, plane(low, 1, -0.5))
    lift = fem.Constant(low, np.array([0.3 * depth, depth]))
    facets = [body.facets(0.0), plane(low, 1, 0.0)][:: -1 if swapped else 1]
    spaces = [body.V, V][:: -1 if swapped else 1]
    surfaces = [qs.Surface(W, facets=f) for W, f in zip(spaces, facets, strict=True)]
    contact = qs.Contact(*surfaces, friction=qs.Coulomb(0.3), **POINTS)
    forms, unknowns = [body.F, elastic(u, E=E, nu=0.3)], [body.u, u]
    bcs = [body.bcs, [fem.dirichletbc(lift, bottom, V)]]
    problem = qs.ContactProblem(forms, unknowns, [contact], bcs)
    problem.solve()
    lift.value[0] += depth
    problem.solve()
    taken = contact.step_dissipation()
    assert taken > 0
    scalars = [fem.functionspace(W.mesh, ("Lagrange", 1)) for W in spaces]
    T = [fem.Function(Q) for Q in scalars]
    dt, c = 0.5, 2.0
    heat = [
        qs.materials.heat(t, 1.0, c, fem.Function(Q), dt) for t, Q in zip(T, scalars, strict=True)
    ]
    fields = [qs.Surface(Q, facets=f) for Q, f in zip(scalars, facets, strict=True)]
    law = qs.Conductance(1.0, friction=0.5)
    qs.ContactProblem(heat, T, [qs.Contact(*fields, law=law, mechanics=contact, dt=dt)]).solve()
    kept = [fem.assemble_scalar(fem.form(c * t * ufl.dx)) for t in T]
    np.testing.assert_allclose(WORLD.allreduce(sum(kept)), taken, rtol=1e-9)
