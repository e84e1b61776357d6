"""R(z) of bodies, multipliers and tools as one system: its derivative, and no side effects."""

from petsc4py import PETSc

import numpy as np
import pytest
from friction.test_friction import LAWS, quadratic_space
from scenes import (
    WORLD,
    Pair,
    clamp,
    drag_top,
    largest,
    plane,
    raises_everywhere,
    vector_space,
)
from tangents import on_edge

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.system.equations import Equations

EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
SOFT = {"enforcement": "penalty"}
NODES = {"constraints": "nodes"}
POINTS = EXACT | {"constraints": "points"}
SOFT_POINTS = SOFT | {"quadrature": "overlay", "constraints": "points"}


#: Steps of the differences, relative to the size of the direction: the first has the least
#: rounding, the others cross fewer kinks.
STEPS = (1e-4, 1e-5, 1e-6)


def away(equations, seed=0, size=0.02):
    """Return random unknowns; only their statistics agree on different numbers of ranks."""
    rng = np.random.default_rng((seed, WORLD.rank))
    scale = np.ones(equations.num_local)
    bodies = equations.bodies_of(scale)
    bodies[:] = size
    for values in equations.multipliers(scale):
        values.normal[:] = 0.1
        if values.tangential is not None:
            values.tangential[:] = 0.03
    equations.displacements(scale)
    return scale * rng.uniform(-1, 1, equations.num_local), scale


def of_groups(equations, values):
    """Forces of the bodies, equations of λ and of τ, and of tools, apart: their sizes differ."""
    groups = [equations.bodies_of(values)]
    for multipliers in equations.multipliers(values):
        groups += [part for part in multipliers if part is not None]
    return [*groups, equations.displacements(values)]


def errors(equations, z, scale, exact=True, seed=1, of=None):
    """Largest error of the tangent against differences of fourth order, relative to its group.

    Groups are those of `of_groups`, or the part of the values that `of` selects. Of several steps,
    the one with the least error counts.
    """
    matrix, rng = equations.tangent(z, exact), np.random.default_rng((seed, WORLD.rank))
    direction = scale * rng.uniform(-1, 1, len(z))
    for i, body in enumerate(equations.system.bodies):
        equations.part(direction, i)[body.owned_constrained] = 0.0
    x, y = matrix.createVecs()
    x.array[:] = direction
    matrix.mult(x, y)
    found = []
    for step in STEPS:
        at = {k: equations.residual(z + k * step * direction) for k in (-2, -1, 1, 2)}
        difference = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * step)
        pair = (y.array_r - difference, difference)
        groups = (of_groups(equations, values) if of is None else [of(values)] for values in pair)
        sizes = [(largest(e), largest(d)) for e, d in zip(*groups, strict=True)]
        found.append(max(e / d for e, d in sizes if d > 0))
    equations.residual(z)
    return min(found)


def equations_of(pair):
    problem = pair.problem()
    problem.set_up()
    equations = Equations(problem.system)
    return problem, equations


@pytest.mark.parametrize(
    "options, penalty",
    (
        (EXACT | NODES, 30.0),
        (SOFT | NODES, 30.0),
        (POINTS, 30.0),
        (SOFT_POINTS, 1.0),
        (SOFT_POINTS, 3000.0),
    ),
    ids=("exact", "soft", "points", "soft points", "stiff points"),
)
@pytest.mark.parametrize("space", (vector_space, quadratic_space), ids=("P1", "P2"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
@pytest.mark.parametrize("law", [None, *LAWS])
def test_derivative(law, cell, space, options, penalty):
    friction = {} if law is None else {"friction": LAWS[law]()}
    if law == "norton":
        friction["dt"] = 0.5
    pair = Pair(cell, space=space, penalty=penalty, contact_options=options | friction, wave=0.02)
    _, equations = equations_of(pair)
    assert pair.contact.model.has_multipliers_at_points == (options is POINTS or penalty == 3000.0)
    z, scale = away(equations)
    assert errors(equations, z, scale) < 1e-8


@pytest.mark.parametrize("options", (EXACT, SOFT), ids=("exact", "soft"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
@pytest.mark.parametrize("law", ("tresca", "norton"))
def test_derivative_on_the_edge_of_contact(law, cell, options):
    """The derivative is right where all constraints have a part of friction that jumps."""
    friction = {"friction": LAWS[law]()} | ({"dt": 0.5} if law == "norton" else {})
    pair = Pair(cell, contact_options=options | NODES | friction, wave=0.02)
    _, equations = equations_of(pair)
    z, scale = away(equations)
    z = on_edge(equations, z)
    assert all(e.tangential.filled.edge.all() for e in equations.evaluate(z).passes)
    assert errors(equations, z, 1e-3 * scale) < 1e-7


@pytest.mark.parametrize("options", (POINTS, SOFT_POINTS), ids=("points", "soft points"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
@pytest.mark.parametrize("law", ("tresca", "norton"))
def test_derivative_on_the_edge_of_points(law, cell, options, monkeypatch):
    """At points on the edge of contact, friction that jumps is a multiple of the pressure."""
    monkeypatch.setattr("qsdolfinx.friction.slip.STEEP", 0.01)
    friction = {"friction": LAWS[law]()} | ({"dt": 0.5} if law == "norton" else {})
    pair = Pair(cell, contact_options=options | friction, wave=0.02)
    _, equations = equations_of(pair)
    z, scale = away(equations)
    at = [e.tangential for e in equations.evaluate(z).passes]
    size, bound = (
        np.concatenate([np.linalg.norm(e.traction, axis=1) for e in at]),
        np.concatenate([0.01 * e.told.pressure for e in at]),
    )
    closed, limited = (
        WORLD.allreduce(int(np.count_nonzero(flags)))
        for flags in (bound > 0, (bound > 0) & (size > 0.999 * bound))
    )
    assert largest(np.maximum(size - bound, 0.0)) <= 1e-12 * largest(bound)
    assert limited > closed / 4
    assert errors(equations, z, scale) < 1e-8


def test_function_of_its_arguments_alone():
    """Evaluations elsewhere in between change only the order of sums over ranks."""
    pair = Pair("triangle", contact_options=EXACT | {"friction": LAWS["coulomb"]()}, wave=0.02)
    _, equations = equations_of(pair)
    z, scale = away(equations)
    first, matrix = equations.residual(z), equations.tangent(z).copy()
    equations.residual(away(equations, seed=5)[0])
    again, scale = equations.residual(z), largest(first)
    assert largest(again - first) <= 1e-14 * scale
    assert (equations.tangent(z) - matrix).norm() <= 1e-14 * matrix.norm()


@pytest.mark.parametrize("law", (None, "coulomb", "tresca", "sticking"))
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_driven_tool(cell, law):
    """The tool's own equation, and the derivatives by its displacement, are right."""
    pair = Pair(cell)
    gdim, up = pair.gdim, np.eye(pair.gdim)[-1]
    tool = qs.RigidSurface.plane(WORLD, np.zeros(gdim), -up)
    tool.drive(0.1, -up)
    friction = {} if law is None else {"friction": LAWS[law]()}
    options = EXACT | NODES | friction
    contact = qs.Contact(pair.master, tool, **options)
    problem = qs.ContactProblem(pair.F[:1], pair.u[:1], [contact], pair.bcs[:1])
    problem.set_up()
    equations = Equations(problem.system)
    z, scale = away(equations)
    assert (
        equations.size == equations.system.comm.allreduce(equations.num_local)
        and len(equations.tools) == 1
    )
    if law == "tresca":
        z, scale = on_edge(equations, z), 1e-3 * scale  # differences of the force keep 5 digits
    assert errors(equations, z, scale) < (1e-6 if law == "tresca" else 1e-8)


@pytest.mark.parametrize("options", (EXACT, EXACT | NODES))
@pytest.mark.parametrize("tied", (False, True))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_held_on_both_sides(cell, tied, options):
    """Redundant multipliers, at nodes held on both sides, are means of their neighbours."""
    pair = Pair(cell, law=qs.Tied() if tied else None, contact_options=options)
    for i in range(2):
        pair.bcs[i].append(clamp(pair.V[i], plane(pair.meshes[i], 0, 0.0)))
    problem, equations = equations_of(pair)
    assert problem.contacts[0].model.gaps[0].extension is not None
    z, scale = away(equations)
    assert errors(equations, z, scale) < 1e-8
    for lift in (-0.2, 0.2):  # closes, or opens where the multipliers are redundant, too
        moved = z.copy()
        equations.part(moved, 0)[pair.gdim - 1 :: pair.gdim] += lift
        equations.part(moved, 0)[equations.system.bodies[0].owned_constrained] = 0.0
        assert errors(equations, moved, scale) < 1e-8


@pytest.mark.parametrize("law", (None, "coulomb"))
def test_ties_and_passes(law):
    """The derivative is right for ties and for both integration sides."""
    friction = {} if law is None else {"friction": LAWS[law]()}
    for formulation, options in (
        ("double-pass", SOFT | friction),
        ("quasi-symmetric", EXACT if law is None else EXACT | friction),
    ):
        tie = qs.Tied() if law is None else None
        pair = Pair("triangle", formulation, law=tie, contact_options=options, wave=0.01)
        _, equations = equations_of(pair)
        z, scale = away(equations)
        assert errors(equations, z, scale) < 1e-8, formulation


def test_unknowns_of_another_pairing():
    """After a contact update at rest the new equations agree; wrong shapes are refused."""
    pair = Pair("triangle", contact_options=EXACT, wave=0.02)
    problem = pair.problem()
    z = problem.equations().first()
    before = problem.residual(z)
    pair.contact.update()
    np.testing.assert_allclose(problem.residual(z), before, atol=1e-12 * largest(before))
    raises_everywhere(WORLD, ValueError, "z: must be of shape", lambda: problem.tangent(z[:-1]))


def test_what_the_caller_gives():
    """Wrong shapes on one rank, values not finite and outdated equations are refused everywhere."""
    pair = Pair("triangle", contact_options=EXACT, wave=0.02)
    problem = pair.problem(solver="direct")
    problem.solve()
    equations = problem.equations()
    z, force = equations.first(), pair.contact.force("slave")
    wrong = z[:-1] if WORLD.rank == WORLD.size - 1 else z
    for call in (equations.residual, equations.tangent, equations.accept):
        raises_everywhere(WORLD, ValueError, "z: must be of shape", lambda c=call: c(wrong))
        raises_everywhere(
            WORLD, ValueError, "z: must be finite", lambda c=call: c(np.inf * (z + 1))
        )
    with pytest.warns(qs.ContactWarning, match="z: no solution"):
        equations.accept(2 * z)
    equations.accept(z)
    np.testing.assert_allclose(pair.contact.force("slave"), force, rtol=1e-8, atol=1e-12)
    pair.contact.update()
    text = "contact pairs were updated since"
    raises_everywhere(WORLD, RuntimeError, text, lambda: equations.residual(z))


class Softened(qs.Unilateral):
    """User-defined contact law."""

    def multiplier(self, gap, penalty):
        return 0.5 * super().multiplier(gap, penalty)

    def slope(self, gap, penalty, touching):
        return 0.5 * super().slope(gap, penalty, touching)


@pytest.mark.parametrize("law", (None, "coulomb", "norton"))
@pytest.mark.parametrize("options", (SOFT, SOFT_POINTS, EXACT, POINTS))
def test_derivative_of_the_users_own(options, law):
    """The derivative is right for user-defined laws with and without their own unknowns."""
    friction = {} if law is None else {"friction": LAWS[law]()}
    if law == "norton":
        friction["dt"] = 0.5
    pair = Pair("triangle", law=Softened(), contact_options=options | friction, wave=0.02)
    _, equations = equations_of(pair)
    assert errors(equations, *away(equations)) < 1e-8


@pytest.mark.parametrize("options", (SOFT | NODES, SOFT_POINTS, SOFT | {"sliding": "finite"}))
def test_laws_of_the_users_own(options):
    """A user-defined law gives the forces of an equal built-in law."""
    forces = []
    soft = 0.25 if "sliding" in options else 1.0  # stiffer points have multipliers, too
    for law, penalty in ((Softened(), 8.0 * soft), (qs.Unilateral(), 4.0 * soft)):
        pair = Pair("triangle", law=law, penalty=penalty, contact_options=options, wave=0.02)
        pair.problem(solver="direct").solve()
        forces.append(pair.contact.force("slave"))
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-9, atol=1e-12)


class HalfTied(qs.Tied):
    """User-defined law of the relative displacement, λ = ε/2 ⟦u⟧."""

    linear = False

    def multiplier(self, gap, penalty):
        return 0.5 * super().multiplier(gap, penalty)

    def slope(self, gap, penalty, touching):
        return 0.5 * super().slope(gap, penalty, touching)


def test_jump_law_of_the_users_own_with_multipliers():
    """λ = φ'(ḡ + λ/ε) holds: half of ε (ḡ + λ/ε) is a tie with λ = ε ḡ."""
    forces = []
    for law, options in ((HalfTied(), EXACT), (qs.Tied(), SOFT), (qs.Tied(), EXACT)):
        pair = Pair("triangle", law=law, penalty=4.0, contact_options=options, wave=0.02)
        _, equations = equations_of(pair)
        assert errors(equations, *away(equations)) < 1e-8
        pair.problem(solver="direct").solve()
        forces.append(pair.contact.force("slave"))
    assert np.allclose(forces[0], forces[1], rtol=1e-3)
    assert not np.allclose(forces[2], forces[1], rtol=1e-2)


class Spring(qs.Law):
    """User-defined law λ = k ⟦u⟧, whatever ε is."""

    jump, linear, stiffness = True, False, 3.0

    def energy(self, gap, penalty):
        return 0.5 * self.stiffness * np.sum(gap**2, axis=1)

    def multiplier(self, gap, penalty):
        return self.stiffness * gap

    def slope(self, gap, penalty, touching):
        return np.full(len(gap), self.stiffness)


def test_law_of_the_users_own_does_not_depend_on_the_penalty():
    """By default, a law of the user's is a tie with this ε, whatever the penalty is."""
    forces = []
    for law, options, penalty in (
        (qs.Tied(), SOFT, Spring.stiffness),
        (Spring(), {}, 50.0),
        (Spring(), {}, "auto"),
    ):
        pair = Pair("triangle", law=law, penalty=penalty, contact_options=options, wave=0.02)
        pair.problem(solver="direct").solve()
        forces.append(pair.contact.force("slave"))
    np.testing.assert_allclose(forces[1:], [forces[0]] * 2, rtol=1e-9, atol=1e-12)


def test_loads_of_now():
    """R uses the present loads, also where it was evaluated before."""
    pair = Pair("triangle", contact_options=EXACT, wave=0.02)
    load = fem.Constant(pair.meshes[1], 1.0)
    pair.F[1] += load * ufl.TestFunction(pair.V[1])[0] * ufl.dx
    problem = pair.problem()
    z = problem.equations().first()
    before = problem.residual(z)
    load.value = 2.0
    after, there = problem.residual(z), problem.residual(z + 1e-13)
    assert largest(after - before) > 1e-3 and largest(after - there) < 1e-9


def test_accepting_is_a_step():
    """Accepting a solution advances friction's history like problem.solve(), without one_step()."""
    energies = []
    for own in (True, False):
        pair = Pair("triangle", contact_options=EXACT | {"friction": qs.Coulomb(0.2)}, load=-0.05)
        problem = pair.problem(solver="direct")
        for shift in (0.0, 0.05, 0.1):
            drag_top(pair, shift, -0.05)
            if own:
                twin = problem.equations()
                z = _newton(twin)
                twin.accept(z)
            else:
                problem.solve()
        energies.append(pair.contact.dissipated_energy())
        problem.destroy()
    assert energies[1] > 0
    np.testing.assert_allclose(energies[0], energies[1], rtol=1e-6)


def _newton(equations):
    """Return a solution, found with full Newton steps."""
    z = equations.first()
    ksp = PETSc.KSP().create(WORLD)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    for _ in range(30):
        R = equations.residual(z)
        if WORLD.allreduce(R @ R) < 1e-26:
            break
        ksp.setOperators(equations.tangent(z, exact=False))
        b, x = ksp.getOperators()[0].createVecs()
        b.array[:] = -R
        ksp.solve(b, x)
        z = z + x.array
    return z
