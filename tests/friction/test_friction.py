"""Friction: tangents, the cone, dissipation, tied contact as a limit, parameters, ranks."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    CELLS,
    FORMULATIONS,
    WORLD,
    Pair,
    allowed,
    drag_top,
    largest,
    mini_space,
    plane,
    raises_everywhere,
)
from tangents import direction, near_solution, tangent_errors

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import active_set


def quadratic_space(msh):
    """Make a space of P2 displacements."""
    return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))


LAWS = {
    "coulomb": lambda: qs.Coulomb(0.3),
    "tresca": lambda: qs.Tresca(0.01),
    "coulomb-tresca": lambda: qs.CoulombTresca(0.4, 0.3, 0.06),
    "norton": lambda: qs.Norton(0.3, 0.4, 0.3),
    "sticking": lambda: qs.Sticking(),
}
OPTIONS = {
    "nodal": {"quadrature": "nodal"},
    "overlay": {"quadrature": "overlay", "constraints": "nodes"},
    "augmented": {
        "quadrature": "overlay",
        "constraints": "nodes",
        "enforcement": "augmented-lagrangian",
        "gap_tolerance": 0.02,
    },
    "points": {"quadrature": "overlay", "constraints": "points"},
    "augmented points": {
        "quadrature": "overlay",
        "constraints": "points",
        "enforcement": "augmented-lagrangian",
        "gap_tolerance": 0.02,
    },
}
KINDS = allowed(FORMULATIONS, OPTIONS)


def pair_of(cell, friction, formulation="quasi-symmetric", options=None, **kwargs):
    """Make two blocks; the top of the upper one is pressed down and dragged along x."""
    options = {"friction": friction, **(options or {})}
    if friction.needs_dt:
        options["dt"] = 0.5
    pair = Pair(cell, formulation, contact_options=options, **kwargs)
    drag_top(pair, 0.0)
    return pair


def problem_of(cell, law, formulation="quasi-symmetric", options=None, shift=0.05, **kwargs):
    """Make a problem whose blocks have been pressed and dragged in two steps."""
    pair = pair_of(cell, LAWS[law](), formulation, options, **kwargs)
    value = np.zeros(pair.gdim)
    load = fem.Constant(pair.meshes[1], value)
    top = plane(pair.meshes[1], pair.gdim - 1, 1.0)
    dofs = fem.locate_dofs_topological(pair.V[1], pair.gdim - 1, top)
    pair.bcs[1][:] = [fem.dirichletbc(load, dofs, pair.V[1])]
    problem = pair.problem()
    load.value[-1] = -0.1
    problem.solve()
    load.value[0] = shift
    problem.solve()
    return pair, problem, load


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("formulation", "options"), KINDS)
@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_finite_differences(cell, formulation, law, options):
    """The tangent agrees with differences for open, sticking and slipping constraints at once."""
    n = (8, 6) if cell == "triangle" else (3, 2)
    pair, problem, _ = problem_of(cell, law, formulation, OPTIONS[options], n=n, wave=0.05)
    contact = pair.contact
    rng = np.random.default_rng(5)
    x, d = near_solution(problem, rng, 0.02), direction(problem, rng)
    errors = tangent_errors(problem, x, d, 1e-8)
    active = WORLD.allreduce(active_set.num_closed(contact.model))
    slipping = WORLD.allreduce(
        sum(int(s.state.response.slipping.sum()) for s in contact.model.slips)
    )
    known, flagged = problem.system.matrix.isSymmetricKnown()
    assert errors.difference < 1e-5
    assert active > 0
    assert slipping > 0 or law == "sticking"
    assert known and flagged == problem.symmetric == contact.model.symmetric
    if contact.model.symmetric:
        assert errors.asymmetry < 1e-12
    else:
        assert errors.asymmetry > 1e-6 or law != "coulomb"


@pytest.mark.parametrize("law", ("coulomb", "tresca", "coulomb-tresca"))
@pytest.mark.parametrize(("formulation", "options"), KINDS)
def test_cone_and_dissipation(formulation, law, options):
    """|τ| ≤ κ(λ), with equality in slip; friction dissipates energy at every node and step."""
    pair, problem, load = problem_of(
        "quadrilateral", law, formulation, OPTIONS[options], n=(8, 6), wave=0.02
    )
    contact = pair.contact
    sides = ["slave", "master"] if formulation == "double-pass" else ["slave"]
    excess, least, slips, dissipated = 0.0, 0.0, 0, 0.0
    for shift in (0.1, 0.4, 0.1, 0.0):
        load.value[0] = shift
        problem.solve()
        for side in sides:
            size = np.linalg.norm(contact.tangential_multiplier(side), axis=1)
            limit = {
                "coulomb": lambda p, _: 0.3 * p,
                # Nodes on the edge of contact slip without pressure.
                "tresca": lambda p, slips: 0.01 * ((p > 0) | slips),
                "coulomb-tresca": lambda p, _: np.minimum(0.4 * p, 0.3 * 0.06 / 3**0.5),
            }[law](contact.multiplier(side), contact.slipping(side))
            excess = max(excess, largest(np.maximum(size - limit * (1 + 1e-6), 0)))
            slips += WORLD.allreduce(int(contact.slipping(side).sum()))
            least = min(
                least, WORLD.allreduce(contact.dissipation(side).min(initial=0), op=MPI.MIN)
            )
        dissipated += contact.step_dissipation()
    total = contact.dissipated_energy()
    assert excess < 1e-15
    assert slips > 0 and least >= 0
    assert 0 < dissipated <= total * (1 + 1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", CELLS)
def test_sticking_is_tied(cell, quadrature, formulation):
    """Sticking friction on a closed interface is tied contact."""
    forces, solutions = [], []
    for law, more in ((qs.Tied(), {}), (qs.Unilateral(), {"friction": qs.Sticking()})):
        options = {"quadrature": quadrature, "constraints": "nodes", "gap_tolerance": 1e-10, **more}
        pair = Pair(cell, formulation, law, contact_options=options)
        drag_top(pair, 0.01)
        problem = pair.problem()
        problem.solve()
        forces.append(pair.contact.force("slave"))
        solutions.append(problem.system.x.array_r.copy())
    difference = largest(solutions[0] - solutions[1]) / largest(solutions[0])
    assert difference < 1e-8
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-8 * np.abs(forces[0]).max())


def test_nothing_without_friction():
    """Without friction there are no tangential constraints, and slip is not available."""
    pair = Pair("quadrilateral")
    pair.problem().solve()
    contact = pair.contact
    assert contact.friction is None and contact.model.parts == contact.model.gaps
    assert set(contact.fields()) == {"traction", "pressure", "gap", "status"}
    assert contact.step_dissipation() == contact.dissipated_energy() == 0
    raises_everywhere(WORLD, ValueError, "friction", contact.slip)
    symmetric = pair.contact.model.symmetric
    assert symmetric


def test_slip_and_history():
    """First stick, then slip; dissipated energy does not come back, and energies agree."""
    pair, problem, load = problem_of("quadrilateral", "coulomb", shift=0.0, n=(8, 6))
    contact = pair.contact
    forces, states, slips = [], [], []
    for shift in (0.002, 0.3, 0.4, 0.398, -0.2):
        load.value[0] = shift
        problem.solve()
        forces.append(contact.force("slave"))
        active = WORLD.allreduce(int(contact.active().sum()))
        states.append(WORLD.allreduce(int(contact.slipping().sum())) / active)
        slips.append(contact.slip()[:, 0])
    mean = [WORLD.allreduce(s.sum()) / WORLD.allreduce(len(s)) for s in slips]
    ratio = [-f[0] / f[1] for f in forces]
    assert states[0] < 0.5 and states[1] == states[2] == 1
    np.testing.assert_allclose(ratio[1:3], 0.3, rtol=1e-9)
    assert abs(ratio[3]) < 0.3 and states[3] < 1
    np.testing.assert_allclose(ratio[4], -0.3, rtol=1e-9)
    assert mean[1] < mean[2] and np.isclose(mean[2] - mean[1], 0.1, rtol=1e-2)
    assert np.isclose(mean[3], mean[2], rtol=1e-2)
    assert mean[4] < mean[3] - 0.1


@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_nothing_moves(cell):
    """Nodes that slipped are at their limit; in a step without motion all nodes stick."""
    pair, problem, _ = problem_of(cell, "coulomb", shift=0.3, n=(4, 3))
    contact = pair.contact
    slipped = WORLD.allreduce(int(contact.slipping().sum()))
    problem.system.residual(problem.system.x.array_r)  # the start of the next step
    again = WORLD.allreduce(int(contact.slipping().sum()))
    taken = contact.step_dissipation()
    assert slipped > 0 and again == 0 and taken == 0


def test_solves_of_one_step():
    """Solves inside one_step() are attempts: each starts from the same history."""
    results = []
    for attempts in (1, 3):
        pair, problem, load = problem_of("quadrilateral", "coulomb", n=(8, 6))
        with problem.one_step():
            for i in range(attempts):
                load.value[0] = 0.2 if i == attempts - 1 else 0.5
                problem.solve()
        results.append((pair.contact.force("slave"), pair.contact.dissipated_energy()))
        results[-1] += (largest(pair.contact.slip()),)
    np.testing.assert_allclose(results[1][0], results[0][0], rtol=1e-7)
    np.testing.assert_allclose(results[1][1:], results[0][1:], rtol=1e-7)


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("law", LAWS)
def test_ranks_do_not_matter(law, options):
    """Forces, slip and dissipation are those of one rank."""
    results = []
    for comm in (MPI.COMM_SELF, WORLD):
        pair, *_ = problem_of(
            "quadrilateral", law, options=OPTIONS[options], n=(6, 5), wave=0.02, comm=comm
        )
        contact = pair.contact
        slip = contact.slip()
        results.append(
            [
                *contact.force("slave"),
                contact.dissipated_energy(),
                comm.allreduce(float((slip[:, 0] ** 2) @ contact.slave.node_area)),
                comm.allreduce(int(contact.slipping().sum())),
            ]
        )
    np.testing.assert_allclose(results[1], results[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("kind", ("constant", "function"))
def test_parameters(formulation, kind):
    """For μ as a Constant or a Function, the present value counts, on either side."""
    pair = Pair("quadrilateral", n=(8, 6))
    if kind == "constant":
        mu = fem.Constant(pair.meshes[1], 0.1)
    else:
        mu = fem.Function(fem.functionspace(pair.meshes[1], ("Lagrange", 1)))
        mu.x.array[:] = 0.1
    slave, master = pair.slave, pair.master
    pair.contact = qs.Contact(
        slave, master, formulation=formulation, penalty=30.0, friction=qs.Coulomb(mu)
    )
    load = fem.Constant(pair.meshes[1], (0.0, -0.1))
    top = plane(pair.meshes[1], 1, 1.0)
    pair.bcs[1][:] = [
        fem.dirichletbc(load, fem.locate_dofs_topological(pair.V[1], 1, top), pair.V[1])
    ]
    problem = pair.problem()
    ratios = []
    for value in (0.1, 0.3):
        if kind == "constant":
            mu.value = value
        else:
            mu.x.array[:] = value
        load.value[0] += 0.5
        problem.solve()
        force = pair.contact.force("slave")
        ratios.append(-force[0] / force[1])
    np.testing.assert_allclose(ratios, [0.1, 0.3], rtol=1e-9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("space", (quadratic_space, mini_space), ids=("quadratic", "mini"))
def test_other_spaces(space, formulation):
    """Friction that varies gives T = Σ μ λ in full slip, for degree 2 and MINI."""
    pair = Pair("triangle", n=(8, 6), space=space, contact_options={"quadrature": "overlay"})
    mu = fem.Function(fem.functionspace(pair.meshes[1], ("Lagrange", 1)))
    mu.interpolate(lambda x: 0.1 + 0.2 * x[0])
    pair.contact = contact = qs.Contact(
        pair.slave,
        pair.master,
        formulation=formulation,
        penalty=30.0,
        constraints="nodes",
        friction=qs.Coulomb(mu),
    )
    drag_top(pair, 1.0)
    problem = pair.problem()
    problem.solve()
    # Both blocks have length 1: nearly ∫ (0.1 + 0.2 x) p dx.
    expected, errors = [], []
    for side in ("slave", "master") if formulation == "double-pass" else ("slave",):
        surface = contact.slave if side == "slave" else contact.master
        x, pressure = surface.node_x[:, 0], contact.multiplier(side)
        tau = contact.tangential_multiplier(side)
        slips = contact.slipping(side)
        inside = slips & (x > 1e-9) & (x < 1 - 1e-9)
        rough = (0.1 + 0.2 * x) * pressure
        errors.append(largest((np.linalg.norm(tau, axis=1) - rough)[inside]) / largest(rough))
        expected.append(WORLD.allreduce(int(slips.sum())))
    assert min(expected) > 3
    # Master nodes use means over the opposite surface.
    assert max(errors) < (0.02 if formulation == "double-pass" else 1e-10)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_function_on_the_other_side(quadrature):
    """Master nodes far from slave nodes use the value of the function opposite them."""
    pair = Pair("quadrilateral", n=(12, 2))
    mu = fem.Function(fem.functionspace(pair.meshes[1], ("Lagrange", 1)))
    mu.interpolate(lambda x: 0.1 + x[0])
    options = {"quadrature": quadrature, "friction": qs.Coulomb(mu)}
    contact = qs.Contact(pair.slave, pair.master, formulation="double-pass", **options)
    second = contact.model.slips[1]
    x = pair.master.node_x[second.gap.rows.reached, 0]
    error = largest((second.parameters["mu"] - 0.1 - x)[(x > 0.4) & (x < 0.6)])
    rows = WORLD.allreduce(len(x))
    # Slave nodes have means over two facets, which are exact except at the ends.
    assert rows == 13 and error < 0.04
