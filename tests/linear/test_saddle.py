"""Newton's step for bodies, multipliers and tools: GMRES agrees with factors of the whole."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, drag_top, elastic, largest, plane, vector_space
from tangents import on_edge

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.linear.saddle import SaddlePoint
from qsdolfinx.linear.saddle_factors import SaddleFactors

AUGMENTED, PENALTY = "augmented-lagrangian", "penalty"

#: Options of contacts: with finite sliding, or tied with conditions on both sides.
KINDS = {
    "frictionless": {"enforcement": AUGMENTED, "constraints": "nodes"},
    "friction": {"enforcement": AUGMENTED, "friction": qs.Coulomb(0.3), "constraints": "nodes"},
    "soft": {"enforcement": PENALTY, "friction": qs.Tresca(0.01), "constraints": "nodes"},
    "stiff": {"enforcement": PENALTY, "penalty": 1e4},
    "tied": {"enforcement": AUGMENTED, "law": qs.Tied()},
    "finite": {"enforcement": AUGMENTED, "friction": qs.Coulomb(0.3), "sliding": "finite"},
    "double-pass": {"formulation": "double-pass", "friction": qs.Coulomb(0.3)},
    "points": {"constraints": "points", "enforcement": AUGMENTED},
    "points, friction": {
        "constraints": "points",
        "enforcement": AUGMENTED,
        "friction": qs.Coulomb(0.3),
    },
    "soft points": {"constraints": "points", "enforcement": PENALTY, "friction": qs.Tresca(0.01)},
}


def scene(cell, kind, solver, **options):
    """Press and drag blocks; return their problem."""
    pair = Pair(cell, n=(5, 4) if cell == "hexahedron" else (8, 6), wave=0.02)
    pair.contact = qs.Contact(pair.slave, pair.master, **KINDS[kind])
    drag_top(pair, 0.02)
    return pair, pair.problem(solver=solver, **options)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_as_by_factors(cell, kind):
    """Unknowns and forces agree as constraints become active, stick or slip."""
    (pair, direct), (other, amg) = (scene(cell, kind, solver) for solver in ("direct", "amg"))
    for problem in (direct, amg):
        problem.solve()
    assert amg.num_linear_iterations > amg.num_iterations and amg.solver_in_use == "amg"
    for u, v in zip(pair.u, other.u, strict=True):
        assert largest(u.x.array - v.x.array) < 1e-7 * largest(u.x.array)
    forces = [p.contact.force("slave") for p in (pair, other)]
    assert largest(forces[0] - forces[1]) < 1e-7 * largest(forces[0])


@pytest.mark.parametrize("options", ({"ksp_type": "gmres", "pc_type": "jacobi"}, {}))
@pytest.mark.parametrize("kind", ("frictionless", "friction", "tied"))
def test_by_options(kind, options):
    """Solvers named by options, or a MatNest, apply to bodies with condensed contact."""
    pair, direct = scene("triangle", kind, "direct")
    given = {"petsc_options": options | {"ksp_rtol": 1e-9}} if options else {}
    other, problem = scene("triangle", kind, "auto" if options else "fieldsplit", **given)
    direct.solve()
    problem.solve()
    for u, v in zip(pair.u, other.u, strict=True):
        assert largest(u.x.array - v.x.array) < 1e-7 * largest(u.x.array)


@pytest.mark.parametrize(
    "kind", ("friction", "edge", "tied", "finite", "double-pass", "points, friction", "soft points")
)
def test_product(kind):
    """The product is that of the inexact derivative, with constraints scaled to forces."""
    _, problem = scene("triangle", "soft" if kind == "edge" else kind, "amg")
    problem.solve()
    equations = problem.equations()
    z = equations.first()
    z = on_edge(equations, z) if kind == "edge" else z
    at = equations.evaluate(z)
    matrix = equations.tangent_of(at, exact=False)
    x, y = matrix.createVecs()
    x.array[:] = np.sin(1.3 * np.arange(*x.owner_range))
    expected, found = y.duplicate(), y
    matrix.mult(x, expected)
    saddle = SaddlePoint(equations, problem.newton.linear)
    saddle.set_up(at, np.zeros(len(equations.bodies_of(z))))
    saddle.mult(None, x, found)
    scale = np.ones(equations.num_local)
    scale[len(equations.bodies_of(z)) :] = saddle.row_scale
    error = largest(found.array_r - scale * expected.array_r)
    assert error < 1e-9 * largest(scale * expected.array_r)
    saddle.free()


def step(factors, at, equations):
    """Return Newton's step."""
    factors.set_up(at, (0.0, 0.0))
    return factors.solve(-equations.residual_of(at))


def test_factors_after_some_that_failed(monkeypatch):
    """After a singular matrix the solver remains usable."""
    _, problem = scene("triangle", "friction", "direct")
    problem.set_up()
    equations = problem.equations()
    at = equations.evaluate(equations.first())
    factors, form = SaddleFactors(equations, problem.newton.linear), equations.tangent_of
    expected = step(factors, at, equations)
    assert expected is not None

    def singular(*args, **kwargs):
        matrix = form(*args, **kwargs)
        empty = matrix.duplicate()
        empty.zeroEntries()
        empty.assemble()
        return empty

    for _ in range(3):
        with monkeypatch.context() as patch:
            patch.setattr(equations, "tangent_of", singular)
            assert step(factors, at, equations) is None and "singular" in factors.reason
    np.testing.assert_allclose(step(factors, at, equations), expected, rtol=1e-9, atol=1e-12)
    factors.destroy()


def test_guesses():
    """An initial guess worse than none does no harm."""
    _, problem = scene("triangle", "friction", "amg")
    problem.solve()
    equations = problem.equations()
    z = equations.first()
    z += 1e-4 * np.sin(np.arange(len(z)))
    at, none = equations.evaluate(z), np.zeros(len(equations.bodies_of(z)))
    saddle, found = SaddlePoint(equations, problem.newton.linear), []
    saddle.set_up(at, none)
    rhs = -equations.residual_of(at)
    for guess in (None, 1e9 * np.cos(np.arange(len(z)))):
        found.append(saddle.solve(rhs, 0.0, exact=True, guess=guess))
    np.testing.assert_array_equal(*found)
    count = saddle.num_iterations
    saddle.solve(rhs, 0.0, exact=True, guess=found[0])
    assert saddle.num_iterations < 2 < count
    saddle.free()


@pytest.mark.parametrize("ratio", (1.0, 1e5, 1e9))
def test_stiff_bodies(ratio):
    """Newton's method takes few iterations, however stiff one of the bodies is."""
    pair = Pair("hexahedron", n=(5, 4), wave=0.02)
    pair.F[1] = elastic(pair.u[1], E=2.0 * ratio)
    pair.contact = qs.Contact(pair.slave, pair.master, **KINDS["frictionless"])
    drag_top(pair, 0.02)
    problem = pair.problem(solver="amg")
    problem.solve()
    assert problem.num_iterations <= 15 and problem.num_restarts == 0


def test_nonlinear_bodies():
    """Nonlinear bodies start with low accuracy, and keep their first coarse spaces."""
    found = []
    for solver in ("direct", "amg"):
        pair, _ = scene("hexahedron", "friction", solver)
        for i, u in enumerate(pair.u):
            stress = qs.materials.neo_hookean(u, 1.0, 1.0)
            pair.F[i] = ufl.inner(stress, ufl.grad(ufl.TestFunction(pair.V[i]))) * ufl.dx
        problem = pair.problem(solver=solver)
        problem.solve()
        found.append(np.concatenate([u.x.array for u in pair.u]))
    assert largest(found[0] - found[1]) < 1e-7 * largest(found[0])


def pushed(solver):
    """A block below a tool that a force drives, and that touches it at one point at first."""
    msh = box(WORLD, (6, 4), "quadrilateral", (0.0, 0.0), (1.0, 1.0))
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.cylinder(WORLD, (0.5, 1.5), None, 0.5)
    tool.drive(0.01, [0.0, -1.0])
    contact = qs.Contact(
        qs.Surface(V, facets=plane(msh, 1, 1.0)), tool, friction=qs.Coulomb(0.3), sliding="finite"
    )
    bcs = [clamp(V, plane(msh, 1, 0.0))]
    qs.ContactProblem(elastic(u), u, contact, bcs, solver=solver).solve()
    return contact.force("slave")


def test_tool_that_nothing_resists():
    """With all constraints open nothing holds the tool: a Krylov solver is as good as factors."""
    direct, iterative = pushed("direct"), pushed("fieldsplit")
    assert largest(direct - iterative) < 1e-7 * largest(direct)
    assert direct[1] == pytest.approx(-0.01)
