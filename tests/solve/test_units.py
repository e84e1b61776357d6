"""Results do not depend on units: the same forces over E L² for any E and L."""

import numpy as np
import pytest
from scenes import WORLD, elastic_form, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

#: E and L of the scenes that are compared with the scene of E = L = 1.
UNITS = ((1e-3, 1e-6), (1e12, 1e-9), (1e-12, 1e3), (1e12, 1e3))
PRESS = 0.05
NU = 0.3


def neo_hookean(u, v, E):
    """Residual of a compressible neo-Hookean body."""
    mu, lam = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    F = ufl.Identity(len(u)) + ufl.grad(u)
    P = mu * (F - ufl.inv(F).T) + lam * ufl.ln(ufl.det(F)) * ufl.inv(F).T
    return ufl.inner(P, ufl.grad(v)) * ufl.dx


class Block:
    """A block of size L with its lower left corner at z."""

    def __init__(self, E, L, n, z, law, dim=2):
        shape = [n] * dim
        low, high = [0.0] * (dim - 1) + [z], [L] * (dim - 1) + [z + L]
        create = mesh.create_rectangle if dim == 2 else mesh.create_box
        self.mesh = create(WORLD, [low, high], shape)
        self.axis = dim - 1
        self.V = vector_space(self.mesh)
        self.u, v = fem.Function(self.V), ufl.TestFunction(self.V)
        modulus = fem.Constant(self.mesh, float(E))
        form = {"linear": lambda u, v, E: elastic_form(u, v, E, NU), "neo-hookean": neo_hookean}
        self.F = form[law](self.u, v, modulus)
        self.bottom, self.top = (self.facets(z + s * L, 1e-3 * L / n) for s in (0, 1))

    def facets(self, value, near):
        """Facets at this height."""
        where = lambda x: np.abs(x[self.axis] - value) < near  # noqa: E731
        return mesh.locate_entities_boundary(self.mesh, self.axis, where)

    def move(self, facets, value):
        """Conditions that move facets along the last axis and fix them along the other axes."""
        values = [value if axis == self.axis else 0.0 for axis in range(self.axis + 1)]
        return [slide(self.V, axis, facets, v) for axis, v in enumerate(values)]


def on_a_plane(E, L, law, travel=0.0, dim=2, **options):
    """A block above a rigid plane, moved down by ``travel`` and pressed on it; contact, problem."""
    n = 6 if dim == 2 else 3
    block = Block(E, L, n, travel * L, law, dim)
    unknown = options.get("unknown", "displacement")
    dt = 0.05 if unknown == "velocity" else 1.0
    bcs = block.move(block.top, -(PRESS + travel) * L / dt)
    near = {"search_radius": 2 * travel * L} if travel else {}
    timed = {"unknown": unknown, "dt": dt} if unknown == "velocity" else {}
    tool = qs.RigidSurface.plane(WORLD, [0.0] * dim, [0.0] * (dim - 1) + [1.0])
    enforcement = options.get("enforcement", "penalty")
    surface = qs.Surface(block.V, facets=block.bottom)
    contact = qs.Contact(surface, tool, enforcement=enforcement, **timed, **near)
    solver = options.get("solver", "direct")
    return contact, qs.ContactProblem([block.F], [block.u], [contact], [bcs], linear_solver=solver)


def on_a_block(E, L, law, ratio=1.0, **options):
    """A block on another block that is ``ratio`` times as stiff; contact and problem."""
    blocks = Block(ratio * E, L, 5, -L, law), Block(E, L, 7, 0.0, law)
    bcs = [blocks[0].move(blocks[0].bottom, 0.0), blocks[1].move(blocks[1].top, -PRESS * L)]
    surfaces = [
        qs.Surface(b.V, facets=f)
        for b, f in zip(blocks, (blocks[0].top, blocks[1].bottom), strict=True)
    ]
    enforcement = options.get("enforcement", "penalty")
    contact = qs.Contact(*surfaces[::-1], enforcement=enforcement, quadrature="overlay")
    F, u = [b.F for b in blocks], [b.u for b in blocks]
    solver = options.get("solver", "direct")
    return contact, qs.ContactProblem(F, u, [contact], bcs, linear_solver=solver)


def force(scene, E, L, *args, **options):
    """Solve; returns the contact force over E L (per depth L in 2D), and iterations."""
    contact, problem = scene(E, L, *args, **options)
    problem.solve()
    out = contact.force("slave")
    iterations = problem.num_iterations
    problem.destroy()
    return out[-1] / (E * L ** (len(out) - 1)), iterations


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("solver", ("direct", "amg", "fieldsplit"))
@pytest.mark.parametrize("law", ("linear", "neo-hookean"))
@pytest.mark.parametrize("scene", (on_a_plane, on_a_block))
def test_forces(scene, law, solver, enforcement):
    """Forces and iterations are the same in metres and pascals as in other units."""
    options = {"solver": solver, "enforcement": enforcement}
    expected, iterations = force(scene, 1.0, 1.0, law, **options)
    assert expected > 0.02
    for E, L in UNITS:
        found, count = force(scene, E, L, law, **options)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        assert abs(count - iterations) <= 2


@pytest.mark.parametrize(
    "law, unknown",
    (("linear", "displacement"), ("linear", "velocity"), ("neo-hookean", "displacement")),
)
def test_forces_in_3d(law, unknown):
    expected, _ = force(on_a_plane, 1.0, 1.0, law, dim=3, unknown=unknown)
    for E, L in UNITS:
        found, _ = force(on_a_plane, E, L, law, dim=3, unknown=unknown)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("law", ("linear", "neo-hookean"))
@pytest.mark.parametrize("travel", (1e3, 1e6))
def test_long_way_to_contact(law, travel):
    """The force is right if the body starts up to a million times its size away."""
    near, _ = force(on_a_plane, 1.0, 1.0, law)
    far, _ = force(on_a_plane, 1.0, 1.0, law, travel=travel)
    np.testing.assert_allclose(far, near, rtol=1e-6)


def test_solve_after_solve():
    """Iterations from the last solution do not depend on the unit of length."""
    found = []
    for L in (1.0, 1e3):
        block = Block(1.0, L, 4, 0.0, "linear")
        tool = qs.RigidSurface.sphere(WORLD, [0.5 * L, 3.0 * L], 2.0 * L)
        contact = qs.Contact(qs.Surface(block.V, facets=block.top), tool, sliding="finite")
        bcs = block.move(block.bottom, 0.0)
        problem, iterations = qs.ContactProblem([block.F], [block.u], [contact], [bcs]), []
        for depth in (0.05, 0.06, 0.0601):
            tool.displacement = [0.0, -depth * L]
            problem.solve()
            iterations.append(problem.num_iterations)
        found.append(iterations)
    assert found[0] == found[1]


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("law", ("linear", "neo-hookean"))
def test_beside_a_stiff_body(law, enforcement):
    """The forces of a body on one 10⁸ times as stiff are those on one 10⁶ times as stiff."""
    options = {"enforcement": enforcement}
    forces = [force(on_a_block, 1.0, 1.0, law, ratio=ratio, **options)[0] for ratio in (1e6, 1e8)]
    np.testing.assert_allclose(forces[1], forces[0], rtol=3e-6)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_viscous_flow(enforcement):
    """A Norton-Hoff block in velocity and pressure works for any ratio of the two."""
    found = []
    for K, L in ((1.0, 1.0), (1e3, 1e-5), (1e-6, 1e-2), (1e12, 1e-9), (1e12, 1e3), (1e-12, 1e-9)):
        msh = mesh.create_rectangle(WORLD, [[0.0, 0.0], [L, L]], [4, 4])
        W = qs.materials.mini_space(msh)
        w = fem.Function(W)
        modulus, slow = fem.Constant(msh, K), fem.Constant(msh, 1e-3)
        stress = qs.materials.norton_hoff(ufl.split(w)[0], modulus, 0.5, slow)
        F = qs.materials.incompressible(w, stress)
        facets = [
            mesh.locate_entities_boundary(msh, 1, lambda x, z=z: np.abs(x[1] - z) < 1e-3 * L)
            for z in (0.0, L)
        ]
        bcs = [slide(W.sub(0), axis, facets[1], -PRESS * L * axis) for axis in (0, 1)]
        surface = qs.Surface(W.sub(0), facets=facets[0])
        tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        contact = qs.Contact(surface, tool, enforcement=enforcement, unknown="velocity", dt=1.0)
        qs.ContactProblem([F], [w], [contact], [bcs]).solve()
        found.append(contact.force("slave")[1] / (K * L))
    assert found[0] > 0.1
    np.testing.assert_allclose(found, found[0], rtol=1e-6)
