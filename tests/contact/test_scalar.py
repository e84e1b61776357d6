"""Contact of scalar fields: patch tests, published values, balances and refused input."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, box, elastic, largest, plane, raises_everywhere, slide
from tangents import direction, tangent_errors

import basix.ufl
import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials

CELLS = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]
#: Conductivities, hardnesses and pressure of the published blocks.
K, HARDNESS, PRESSURE = (16.2, 210.0), (129.0, 15.0), 100.0


def field(msh, degree=1):
    return fem.functionspace(msh, ("Lagrange", degree))


def at(V, axis, value, temperature):
    """Make a Dirichlet condition in a plane; the temperature may be a Function."""
    dofs = fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, plane(V.mesh, axis, value))
    if isinstance(temperature, fem.Function):
        return fem.dirichletbc(temperature, dofs)
    return fem.dirichletbc(float(temperature), dofs, V)


def total(form):
    return WORLD.allreduce(fem.assemble_scalar(fem.form(form)))


class Blocks:
    """Two stacked blocks of length 1 with non-matching meshes."""

    def __init__(self, cell, degree=1, finer=1, partition=None, offset=0.0):
        self.gdim = 2 if cell in CELLS[:2] else 3
        sides = [(2, 3), (3, 2)] if self.gdim == 2 else [(2, 2, 3), (3, 3, 2)]
        self.spaces, self.T, self.F = [], [], []
        for i, n in enumerate(sides):
            low, high = np.zeros(self.gdim), np.ones(self.gdim)
            low[-1], high[-1] = i + i * offset, i + 1 + i * offset
            n = [finer * cells for cells in n]
            msh = box(WORLD, n, cell, low.tolist(), high.tolist(), partition)
            self.spaces.append(field(msh, degree))
            self.T.append(fem.Function(self.spaces[-1]))
            self.F.append(materials.heat(self.T[-1], K[i]))
        self.surfaces = [
            qs.Surface(V, facets=plane(V.mesh, self.gdim - 1, 1.0 + i * offset))
            for i, V in enumerate(self.spaces)
        ]

    def ends(self, low, high):
        axis = self.gdim - 1
        return [[at(self.spaces[0], axis, 0.0, low)], [at(self.spaces[1], axis, 2.0, high)]]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_patch_of_a_tie(cell, degree):
    """A linear field with conditions on the whole boundary is exact, as is its flux k ∂T/∂n."""
    scene = Blocks(cell, degree)
    gradient = np.array([2.0, -3.0, 5.0])[: scene.gdim]
    k, bcs = 2.0, []
    for i, V in enumerate(scene.spaces):
        exact = fem.Function(V)
        exact.interpolate(lambda x: 7.0 + gradient @ x[: scene.gdim])
        planes = [(axis, end) for axis in range(scene.gdim - 1) for end in (0.0, 1.0)]
        planes.append((scene.gdim - 1, 2.0 * i))
        bcs.append([at(V, axis, end, exact) for axis, end in planes])
        scene.F[i] = materials.heat(scene.T[i], k)
    contact = qs.Contact(scene.surfaces[1], scene.surfaces[0], law=qs.Tied())
    qs.ContactProblem(scene.F, scene.T, [contact], bcs).solve()
    for T in scene.T:
        exact = 7.0 + ufl.dot(ufl.as_vector(gradient), ufl.SpatialCoordinate(T.function_space.mesh))
        assert total((T - exact) ** 2 * ufl.dx) < 1e-18
    assert contact.flow("slave") == pytest.approx(-k * gradient[-1], rel=1e-8)
    assert contact.flow("master") == pytest.approx(k * gradient[-1], rel=1e-8)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_published_blocks(cell, degree):
    """Ends at 800 and 250 degrees, h by pressure and hardness: q = 7292.02."""
    scene = Blocks(cell, degree)
    slave, master = zip(K, HARDNESS, strict=True)
    h = qs.rough_surfaces(slave=slave, master=master)(PRESSURE, 0.0)
    assert h == pytest.approx(111.93, abs=0.01)
    contact = qs.Contact(*scene.surfaces, law=qs.Conductance(float(h)))
    problem = qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0))
    problem.solve()
    assert problem.symmetric and problem.num_iterations == 1
    assert contact.flow("master") == pytest.approx(7292.02, abs=0.01)
    assert contact.flow("slave") == pytest.approx(-contact.flow("master"), rel=1e-12)
    flux = contact.slave.linear.node_values(contact.flux("slave"))
    np.testing.assert_allclose(flux, -contact.flow("master"), rtol=1e-9)


@pytest.mark.parametrize("law", [qs.Tied(), qs.Conductance(2.0)])
def test_order(law):
    """A smooth field across non-matching meshes: errors decrease with h² in L²."""
    errors = []
    for finer in (2, 4, 8):
        scene = Blocks("triangle", finer=finer)
        jump = 0.0 if isinstance(law, qs.Tied) else np.pi / 4  # q = k ∂T/∂y = h ⟦T⟧, k = 1
        exact = []
        for i, V in enumerate(scene.spaces):
            x = ufl.SpatialCoordinate(V.mesh)
            wave = ufl.cos(np.pi * x[0])
            exact.append(wave * (ufl.sin(np.pi / 2 * (x[1] - 1.0)) + jump * i))
            T, test = scene.T[i], ufl.TestFunction(V)
            source = -ufl.div(ufl.grad(exact[-1]))
            scene.F[i] = materials.heat(T, 1.0) - source * test * ufl.dx
        bcs = []
        for i, V in enumerate(scene.spaces):
            value = fem.Function(V)
            value.interpolate(fem.Expression(exact[i], qs.compat.interpolation_points(V)))
            bcs.append([at(V, 1, 2.0 * i, value)])
        contact = qs.Contact(*scene.surfaces, law=law)
        qs.ContactProblem(scene.F, scene.T, [contact], bcs).solve()
        errors.append(sum(total((T - e) ** 2 * ufl.dx) for T, e in zip(scene.T, exact)) ** 0.5)
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] > 1.8


class Pressed(Blocks):
    """The blocks pressed together, with displacements that do not depend on the temperatures."""

    def __init__(self, cell="triangle", press=0.1, order=1, sliding="small", **options):
        super().__init__(cell, **options)
        self.u, forms, self.bcs, surfaces = [], [], [], []
        axis = self.gdim - 1
        for i, V in enumerate(self.spaces):
            W = fem.functionspace(V.mesh, ("Lagrange", order, (self.gdim,)))
            u = fem.Function(W)
            sides = [slide(W, other, plane(V.mesh, other, 0.0)) for other in range(axis)]
            end = slide(W, axis, plane(V.mesh, axis, 2.0 * i), -press * i)
            self.u.append(u)
            forms.append(elastic(u, E=10.0, nu=0.0))
            self.bcs.append([*sides, end])
            surfaces.append(qs.Surface(W, facets=self.surfaces[i].facets))
        self.contact = qs.Contact(*surfaces, sliding=sliding)
        self.problem = qs.ContactProblem(forms, self.u, [self.contact], self.bcs)


@pytest.mark.parametrize("order, sliding", [(1, "small"), (2, "small"), (1, "finite")])
@pytest.mark.parametrize("cell", CELLS)
def test_conductance_of_the_pressure(cell, order, sliding):
    """h = c p for bodies pressed by p = E ε; the field uses the pairs of the bodies, P1 or P2."""
    scene = Pressed(cell, order=order, sliding=sliding)
    scene.problem.solve()
    law = qs.Conductance(lambda p, g: 3.0 * p + 0.0 * g)
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.contact)
    if sliding == "small":
        assert len(contact.pairing) == len(scene.contact.pairing)
        np.testing.assert_array_equal(contact.pairing.weight, scene.contact.pairing.weight)
    qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0)).solve()
    h = 3.0 * 10.0 * 0.05
    expected = 550.0 / (1 / K[0] + 1 / h + 1 / K[1])
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("tool", [False, True])
def test_gas_in_a_gap(tool):
    """With a gap of 0.05, h = k_gas/(g + δ), between bodies or to a tool of a given temperature."""
    scene, gap = Pressed(press=-0.05), 0.05
    law = qs.rough_surfaces(conductivity=K, hardness=HARDNESS, gas=0.3, roughness=0.01)
    h = 0.3 / (gap + 0.01)
    if tool:
        die = qs.RigidSurface.plane(WORLD, [0.0, 1.0 + gap], [0.0, -1.0])
        bodies = qs.Contact(scene.contact.slave, die)
        problem = qs.ContactProblem([elastic(scene.u[0])], scene.u[:1], [bodies], [scene.bcs[0]])
        problem.solve()
        contact = qs.Contact(
            scene.surfaces[0], die, law=qs.Conductance(law, tool=250.0), mechanics=bodies
        )
        ends = scene.ends(800.0, 250.0)[:1]
        qs.ContactProblem(scene.F[:1], scene.T[:1], [contact], ends).solve()
        expected = 550.0 / (1 / K[0] + 1 / h)
    else:
        scene.problem.solve()
        contact = qs.Contact(*scene.surfaces, law=qs.Conductance(law), mechanics=scene.contact)
        qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0)).solve()
        expected = 550.0 / (1 / K[0] + 1 / h + 1 / K[1])
    assert contact.flow("slave") == pytest.approx(-expected, rel=1e-7)
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)


def test_gas_below_a_tool_that_moves():
    """The gap is that to the tool at the end of its motion."""
    scene, gap = Pressed(press=-0.05), 0.05
    die = qs.RigidSurface.plane(WORLD, [0.0, 1.03], [0.0, -1.0])
    bodies = qs.Contact(scene.contact.slave, die, search_radius=0.2)
    problem = qs.ContactProblem([elastic(scene.u[0])], scene.u[:1], [bodies], [scene.bcs[0]])
    die.displacement = [0.0, gap - 0.03]
    problem.solve()
    gas = qs.rough_surfaces(conductivity=K, hardness=HARDNESS, gas=0.3, roughness=0.01)
    law = qs.Conductance(gas, tool=250.0)
    contact = qs.Contact(scene.surfaces[0], die, law=law, mechanics=bodies)
    ends = scene.ends(800.0, 250.0)[:1]
    qs.ContactProblem(scene.F[:1], scene.T[:1], [contact], ends).solve()
    expected = 550.0 / (1 / K[0] + (gap + 0.01) / 0.3)
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("wide", (False, True))
def test_gaps_beyond_the_search_radius(wide):
    """A conductance that acts across gaps gives a warning; one that needs pressure does not."""
    scene = Pressed(press=-0.05)
    normal = np.array([-0.6, -1.0]) / np.hypot(0.6, 1.0)
    die = qs.RigidSurface.plane(WORLD, [0.0, 1.05], normal)  # the gap to it grows along x
    surface = scene.contact.slave
    radius = {"search_radius": 1.0} if wide else {"search_radius": 0.2}
    bodies = qs.Contact(surface, die, **radius)
    qs.ContactProblem([elastic(scene.u[0])], scene.u[:1], [bodies], [scene.bcs[0]]).solve()
    assert (bodies.num_unpaired == 0) == wide

    def flow(h):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", qs.ContactWarning)
            law = qs.Conductance(h, tool=250.0)
            contact = qs.Contact(scene.surfaces[0], die, law=law, mechanics=bodies)
            ends = scene.ends(800.0, 250.0)[:1]
            qs.ContactProblem(scene.F[:1], scene.T[:1], [contact], ends).solve()
        told = [str(w.message) for w in caught if str(w.message).startswith("h: ")]
        return contact.flow("master"), told

    _, told = flow(lambda p, g: 2.0 / (g + 0.05))
    assert len(told) == (0 if wide else 1)
    assert wide or "search_radius above the widest gap" in told[0]
    assert flow(lambda p, g: 3.0 * p + 1.0 * (g < 0.1))[1] == []


def test_radiation():
    """h = σ (T_s² + T_m²)(T_s + T_m): q = σ (T_s⁴ − T_m⁴) of the faces' temperatures."""
    scene, sigma = Pressed(press=-0.05), 5e-8
    scene.problem.solve()
    law = qs.Conductance(qs.rough_surfaces(conductivity=K, hardness=HARDNESS, radiation=sigma))
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.contact)
    problem = qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(1500.0, 300.0))
    problem.solve()
    assert problem.num_iterations < 8 and not problem.symmetric
    q = contact.flow("master")
    faces = 1500.0 - q / K[0], 300.0 + q / K[1]
    assert q == pytest.approx(sigma * (faces[0] ** 4 - faces[1] ** 4), rel=1e-7)


@pytest.mark.parametrize("share, sliding", [(0.25, "small"), (1.0, "small"), (0.25, "finite")])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_heat_of_friction(cell, share, sliding):
    """Friction energy arrives as heat, and nothing else does: both bodies are insulated."""
    scene = Pressed(cell, finer=2)
    u = scene.u
    friction = qs.Contact(
        *(surface for surface in (scene.contact.slave, scene.contact.master)),
        friction=qs.Coulomb(0.3),
        sliding=sliding,
    )
    W = u[1].function_space
    top = plane(W.mesh, scene.gdim - 1, 2.0)
    clamped = [slide(W, axis, top, -0.1 * (axis == scene.gdim - 1)) for axis in range(scene.gdim)]
    low = u[0].function_space
    bottom = plane(low.mesh, scene.gdim - 1, 0.0)
    held = [slide(low, axis, bottom) for axis in range(scene.gdim)]
    forms = [elastic(v, E=10.0, nu=0.0) for v in u]
    problem = qs.ContactProblem(forms, u, [friction], [held, clamped])
    problem.solve()
    clamped[0].g.value[...] = 0.4
    problem.solve()
    dissipated = friction.step_dissipation()
    assert dissipated > 0.01
    dt, c = 0.2, 3.0
    before = [fem.Function(V) for V in scene.spaces]
    forms = [materials.heat(*pair, c, old, dt) for *pair, old in zip(scene.T, K, before)]
    law = qs.Conductance(1e-9, friction=share)
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=friction, dt=dt)
    qs.ContactProblem(forms, scene.T, [contact]).solve()
    taken = [total(c * T * ufl.dx) for T in scene.T]
    assert sum(taken) == pytest.approx(dissipated, rel=1e-12)
    assert taken[0] == pytest.approx(share * dissipated, rel=1e-6)
    assert dt * contact.flow("slave") == pytest.approx(taken[0], rel=1e-9)


def test_shares_of_effusivity():
    share = qs.effusivity_share(slave=(4.0, 9.0), master=(1.0, 4.0))
    assert share == pytest.approx(6.0 / 8.0)


@pytest.mark.parametrize("law", (qs.rough_surfaces, qs.effusivity_share))
def test_pairs_have_names(law):
    """Pairs without names are refused: numbers do not tell bodies and properties apart."""
    name = law.__name__
    with pytest.raises(TypeError, match=rf"give both by name, {name}\(slave=\(k"):
        law(K, HARDNESS)
    with pytest.raises(TypeError, match="give both by name"):
        law(slave=K)
    with pytest.raises(ValueError, match="master: must be a pair"):
        law(slave=K, master=3.0)
    with pytest.raises(ValueError, match="slave: must be"):
        law(slave=(-1.0, 2.0), master=K)
    if law is qs.rough_surfaces:
        assert law(slave=(1.0, 2.0), master=(3.0, 4.0))(1.0, 0.0) == pytest.approx(
            law(conductivity=(1.0, 3.0), hardness=(2.0, 4.0))(1.0, 0.0)
        )
        with pytest.raises(TypeError, match="give both by name"):
            law(slave=K, master=K, hardness=K)


@pytest.mark.parametrize("solver", ["direct", "amg"])
@pytest.mark.parametrize("law", [qs.Tied(), qs.Conductance(30.0)])
def test_linear_solvers(law, solver):
    """Solvers work as with any contact; the near-nullspace of a scalar field is a constant."""
    scene = Blocks("tetrahedron", finer=2)
    contact = qs.Contact(*scene.surfaces, law=law)
    problem = qs.ContactProblem(
        scene.F, scene.T, [contact], scene.ends(800.0, 250.0), linear_solver=solver
    )
    problem.solve()
    between = 0.0 if isinstance(law, qs.Tied) else 1 / 30.0
    expected = 550.0 / (1 / K[0] + between + 1 / K[1])
    assert contact.flow("master") == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("sliding", ["small", "finite"])
@pytest.mark.parametrize("partition", ["backward", "scattered", "last"])
def test_ranks_without_facets(partition, sliding):
    """A rank may have no contact facet, and a pair may span ranks."""
    scene = Pressed("triangle", partition=partition, sliding=sliding)
    scene.problem.solve()
    law = qs.Conductance(qs.rough_surfaces(conductivity=K, hardness=HARDNESS))
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.contact)
    qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0)).solve()
    h = 2 / (1 / K[0] + 1 / K[1]) * 0.5 / (2 / (1 / HARDNESS[0] + 1 / HARDNESS[1]))
    expected = 550.0 / (1 / K[0] + 1 / h + 1 / K[1])
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)


class Rod:
    """Displacement and temperature in one space: a hot rod expands to the wall that cools it."""

    E, alpha, gap, hot, k, c = 100.0, 1e-2, 0.5, 100.0, 2.0, 0.5

    def __init__(self, **options):
        msh = box(WORLD, (1, 8), "quadrilateral", [0.0, 0.0], [0.2, 1.0])
        cell = msh.basix_cell()
        pair = [basix.ufl.element("Lagrange", cell, 1, shape=s) for s in ((2,), ())]
        W = fem.functionspace(msh, basix.ufl.mixed_element(pair))
        self.w = fem.Function(W)
        (u, T), (v, test) = ufl.split(self.w), ufl.TestFunctions(W)
        stress = materials.linear_elastic(u, self.E, 0.0, thermal_strain=self.alpha * T)
        F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
        F += self.k * ufl.inner(ufl.grad(T), ufl.grad(test)) * ufl.dx
        facets, foot = plane(msh, 1, 1.0), plane(msh, 1, 0.0)
        sides = (slide(W.sub(0), 0, plane(msh, 0, x)) for x in (0.0, 0.2))
        bcs = [slide(W.sub(0), 1, foot), *sides]
        dofs = fem.locate_dofs_topological(W.sub(1), 1, foot)
        bcs.append(fem.dirichletbc(fem.Constant(msh, self.hot), dofs, W.sub(1)))
        wall = qs.RigidSurface.plane(WORLD, [0.0, 1.0 + self.gap], [0.0, -1.0])
        surface = qs.Surface(W.sub(0), facets=facets)
        self.bodies = qs.Contact(surface, wall, search_radius=1.0, **options)
        law = qs.Conductance(lambda p, g: self.c * p + 1e-12, tool=0.0)
        surface = qs.Surface(W.sub(1), facets=facets)
        self.heat = qs.Contact(surface, wall, law=law, mechanics=self.bodies)
        self.problem = qs.ContactProblem([F], [self.w], [self.heat, self.bodies], [bcs])


@pytest.mark.parametrize("constraints", ["nodes", "points"])
def test_derivative_by_pressures(constraints):
    """Derivative of a flow that depends on multipliers, which are unknowns beside the field."""
    rod = Rod(constraints=constraints)
    rod.problem.solve()
    equations = rod.problem.equations()
    z, rng = equations.first(), np.random.default_rng(WORLD.rank)
    direction = rng.uniform(-1, 1, len(z))
    equations.part(direction, 0)[equations.system.bodies[0].owned_constrained] = 0.0
    matrix = equations.tangent(z)
    x, y = matrix.createVecs()
    x.array[:] = direction
    matrix.mult(x, y)
    ahead, behind = (equations.residual(z + step * direction) for step in (1e-6, -1e-6))
    assert largest(y.array_r - (ahead - behind) / 2e-6) < 1e-6 * largest(y.array_r)


@pytest.mark.parametrize("in_steps", [False, True])
def test_rod_that_closes_its_gap(in_steps):
    """The hot rod expands to the wall that cools it.

    T falls linearly from T₀ to T_L, p = E (α (T₀ + T_L)/2 − g/L), and k (T₀ − T_L)/L = h T_L with
    h = c p.
    """
    rod = Rod()
    problem, bodies, heat = rod.problem, rod.bodies, rod.heat
    E, alpha, gap, hot, k, c = rod.E, rod.alpha, rod.gap, rod.hot, rod.k, rod.c
    if in_steps:
        for _ in qs.TimeStepper(problem, 0.5).run(1.0):
            pass
    else:
        problem.solve()
        assert problem.num_iterations < 20

    def rest(end):
        p = max(E * (alpha * (hot + end) / 2 - gap), 0.0)
        return k * (hot - end) - c * p * end

    low, high = 0.0, hot
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if rest(middle) > 0 else (low, middle)
    p = E * (alpha * (hot + low) / 2 - gap)
    assert p > 1.0
    assert bodies.force("master")[1] == pytest.approx(0.2 * p, rel=1e-6)
    assert heat.flow("master") == pytest.approx(0.2 * k * (hot - low), rel=1e-6)


@pytest.mark.parametrize("constraints", ["nodes", "points"])
@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_tangent(cell, constraints):
    """Tangent of a mixed unknown, with h of p, g and both temperatures, agrees with differences."""
    gdim = 2 if cell == "triangle" else 3
    w, forms, surfaces, fields, bcs = [], [], [], [], []
    for i in range(2):
        low, high = np.zeros(gdim), np.ones(gdim)
        low[-1], high[-1] = i, i + 1
        msh = box(WORLD, [2 + i] * gdim, cell, low.tolist(), high.tolist())
        pair = [basix.ufl.element("Lagrange", msh.basix_cell(), 1, shape=s) for s in ((gdim,), ())]
        W = fem.functionspace(msh, basix.ufl.mixed_element(pair))
        w.append(fem.Function(W))
        (u, T), (v, test) = ufl.split(w[i]), ufl.TestFunctions(W)
        stress = materials.linear_elastic(u, 10.0, 0.3, thermal_strain=1e-3 * T)
        F = ufl.inner(stress, ufl.grad(v)) + K[i] * ufl.inner(ufl.grad(T), ufl.grad(test))
        forms.append(F * ufl.dx)
        facets = plane(msh, gdim - 1, 1.0)
        surfaces.append(qs.Surface(W.sub(0), facets=facets))
        fields.append(qs.Surface(W.sub(1), facets=facets))
        bcs.append([slide(W.sub(0), a, plane(msh, gdim - 1, 2.0 * i)) for a in range(gdim)])
    options = {"enforcement": "penalty", "penalty": 50.0, "constraints": constraints}
    bodies = qs.Contact(*surfaces, **options)

    def h(p, g, slave, master):
        return 1.0 + p + 0.1 / (g + 0.1) + 0.02 * slave**2 + 0.01 * master

    heat = qs.Contact(*fields, law=qs.Conductance(h), mechanics=bodies)
    problem = qs.ContactProblem(forms, w, [bodies, heat], bcs)
    problem.set_up()
    rng = np.random.default_rng(3)
    x, way = direction(problem, rng), direction(problem, rng)
    x.scale(0.05)
    assert tangent_errors(problem, x, way, 1e-6).difference < 1e-7


# --- Found by an independent user


@pytest.mark.parametrize("law", [qs.Tied(), qs.Conductance(2.0)])
def test_one_multiplier(law):
    scene = Blocks("triangle")
    with pytest.raises(ValueError, match="formulation: scalar fields have one multiplier"):
        qs.Contact(*scene.surfaces, formulation="double-pass", law=law)


@pytest.mark.parametrize("of_state", [False, True])
def test_constants_that_change(of_state):
    """Constants h and a tool's temperature may change between solves; a negative h is refused."""
    scene = Pressed()
    die = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    bodies = qs.Contact(scene.contact.slave, die)
    scene.bcs[0].append(
        slide(scene.u[0].function_space, 1, plane(scene.u[0].function_space.mesh, 1, 0.0), 0.05)
    )
    qs.ContactProblem([elastic(scene.u[0])], scene.u[:1], [bodies], [scene.bcs[0]]).solve()
    msh = scene.spaces[0].mesh
    h, tool = fem.Constant(msh, 3.0), fem.Constant(msh, 100.0)
    law = qs.Conductance((lambda p, g: float(h.value) + 0.0 * p) if of_state else h, tool=tool)
    contact = qs.Contact(scene.surfaces[0], die, law=law, mechanics=bodies)
    ends = scene.ends(800.0, 0.0)[:1]
    problem = qs.ContactProblem(scene.F[:1], scene.T[:1], [contact], ends)
    for h.value, tool.value in ((3.0, 100.0), (3.0, 700.0), (0.5, 700.0), (0.0, 300.0), (2.0, 9.0)):
        problem.solve()
        conducts = 1 / (1 / K[0] + 1 / h.value) if h.value > 0 else 0.0
        expected = (800.0 - tool.value) * conducts
        assert contact.flow("master") == pytest.approx(expected, rel=1e-9, abs=1e-9)
    h.value = -1.0
    with pytest.raises(ValueError, match=r"^h: "):
        problem.solve()
    h.value, tool.value = 1.0, np.nan
    with pytest.raises(ValueError, match=r"^tool: "):
        problem.solve()


@pytest.mark.parametrize("share, sliding", [(0.0, "small"), (0.3, "small"), (0.3, "finite")])
def test_heat_of_friction_into_a_tool(share, sliding):
    """The heat flowing into both sides is the energy that friction has dissipated."""
    scene = Pressed()
    W = scene.u[0].function_space
    die = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    friction = qs.Contact(scene.contact.slave, die, friction=qs.Coulomb(0.3), sliding=sliding)
    low = plane(W.mesh, 1, 0.0)
    bcs = [slide(W, 0, low, 0.0), slide(W, 1, low, 0.05)]
    problem = qs.ContactProblem([elastic(scene.u[0])], scene.u[:1], [friction], [bcs])
    problem.solve()
    bcs[0].g.value[...] = 0.3
    problem.solve()
    power = friction.step_dissipation() / 0.1
    assert power > 1e-3
    law = qs.Conductance(5.0, tool=20.0, friction=share)
    contact = qs.Contact(scene.surfaces[0], die, law=law, mechanics=friction, dt=0.1)
    qs.ContactProblem(scene.F[:1], scene.T[:1], [contact], scene.ends(20.0, 0.0)[:1]).solve()
    both = contact.flow("slave") + contact.flow("master")
    assert both == pytest.approx(power, rel=1e-10)


@pytest.mark.parametrize("units", [1e-9, 1e-5, 1.0, 1e8])
@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
def test_ties_in_any_units(units, length):
    """The final jump of a tied field is a small part of the field, whatever the units of length."""
    scene = Blocks("triangle")
    bcs = scene.ends(8.0 * units, 0.0)
    for V in scene.spaces:
        V.mesh.geometry.x[:] *= length
    surfaces = [qs.Surface(known.V, facets=known.facets) for known in scene.surfaces]
    contact = qs.Contact(*surfaces)
    qs.ContactProblem(scene.F, scene.T, [contact], bcs).solve()
    expected = 8.0 * units / (1 / K[0] + 1 / K[1])
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)


def test_bodies_that_are_not_solved_for():
    """Bodies that are not solved, or were not since a contact update, are refused."""
    scene = Pressed()
    law = qs.Conductance(lambda p, g: 1.0 + p)
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.contact)
    problem = qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0))
    text = "mechanics: the bodies have been paired and not solved for since"
    with pytest.raises(RuntimeError, match=text):
        problem.solve()
    scene.problem.solve()
    problem.solve()
    scene.contact.update()
    with pytest.raises(RuntimeError, match=text):
        problem.solve()


def test_no_overclosure():
    """Scalar fields have no overclosure that a part could be allowed of."""
    contact = qs.Contact(*Blocks("triangle").surfaces, law=qs.Conductance(1.0))
    raises_everywhere(
        WORLD, ValueError, "scalar fields have no", lambda: contact.allow_overclosure(0.5)
    )


@pytest.mark.several_ranks
def test_numbers_that_differ_between_ranks():
    scene = Blocks("triangle")
    text = "h: must be the same on all ranks"
    with pytest.raises(ValueError, match=text):
        qs.Contact(*scene.surfaces, law=qs.Conductance(1.0 + WORLD.rank))
    h = fem.Constant(scene.spaces[0].mesh, 1.0)
    contact = qs.Contact(*scene.surfaces, law=qs.Conductance(h))
    problem = qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(1.0, 0.0))
    h.value += WORLD.rank
    with pytest.raises(ValueError, match=text):
        problem.solve()


class OnADie(Pressed):
    """The lower block below a rigid tool that has its own mesh for its temperature."""

    def __init__(self, friction=None):
        super().__init__()
        die = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        W = self.u[0].function_space
        low = plane(W.mesh, 1, 0.0)
        self.held = [slide(W, 0, low), slide(W, 1, low, 0.05)]
        self.bodies = qs.Contact(self.contact.slave, die, friction=friction)
        forms = [elastic(self.u[0], E=10.0, nu=0.0)]
        self.press = qs.ContactProblem(forms, self.u[:1], [self.bodies], [self.held])


def test_die_with_a_mesh_of_its_own():
    """The field has its own contact detection with the bodies' pressure: p = E ε, h = c p."""
    scene = OnADie()
    scene.press.solve()
    law = qs.Conductance(lambda p, g: 3.0 * p + 0.0 * g)
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.bodies, search_radius=0.2)
    assert contact.settings.search_radius == 0.2
    qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(800.0, 250.0)).solve()
    expected = 550.0 / (1 / K[0] + 1 / (3.0 * 10.0 * 0.05) + 1 / K[1])
    assert contact.flow("master") == pytest.approx(expected, rel=1e-7)
    assert contact.flow("slave") == pytest.approx(-expected, rel=1e-7)


def test_heat_of_friction_on_such_a_die():
    """No frictional heat is lost, also if the meshes of the field do not match."""
    scene = OnADie(qs.Coulomb(0.3))
    scene.press.solve()
    scene.held[0].g.value[...] = 0.3
    scene.press.solve()
    power = scene.bodies.step_dissipation() / 0.1
    assert power > 1e-3
    law = qs.Conductance(5.0, friction=0.3)
    contact = qs.Contact(*scene.surfaces, law=law, mechanics=scene.bodies, dt=0.1)
    qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(20.0, 20.0)).solve()
    both = contact.flow("slave") + contact.flow("master")
    assert both == pytest.approx(power, rel=1e-10)


def test_nothing_opposite():
    """Blocks beside each other are insulated, with a warning."""
    surfaces = []
    for low in (0.0, 2.0):
        msh = box(WORLD, (3, 3), "triangle", [low, 0.0], [low + 1.0, 1.0])
        surfaces.append(qs.Surface(field(msh), facets=plane(msh, 1, 1.0 if low == 0 else 0.0)))
    with pytest.warns(qs.ContactWarning, match="nothing is opposite|search_radius"):
        qs.Contact(*surfaces, law=qs.Conductance(1.0))


def test_more_is_refused():
    scene = Pressed()
    pair, of = scene.surfaces, scene.contact
    msh = scene.spaces[0].mesh

    def conducts(text, h, error=ValueError):
        with pytest.raises(error, match=text):
            contact = qs.Contact(*pair, law=qs.Conductance(h), mechanics=of)
            qs.ContactProblem(scene.F, scene.T, [contact], scene.ends(1.0, 0.0)).solve()

    scene.problem.solve()
    conducts("h: must return a real number for each point", lambda p, g: np.ones(3))
    conducts("h: must return a real number for each point", lambda p, g: "much")
    conducts("h: must return a real number for each point", lambda p, g: p + 1j)
    conducts("h: must be finite and not negative, not -1 at", lambda p, g: p * 0 - 1.0)
    conducts("h: must be a number, a dolfinx.fem.Constant, or a Python", "much", TypeError)
    conducts("h: must be a number, a dolfinx.fem.Constant, or a Python", scene.T[0], TypeError)
    conducts("h: must be a Constant of one number", fem.Constant(msh, (1.0, 2.0)))
    with pytest.raises(ValueError, match="conductivity: must be a pair"):
        qs.rough_surfaces(conductivity=3.0, hardness=(1.0, 2.0))
    with pytest.raises(ValueError, match="mechanics: exchange slave and master"):
        qs.Contact(*pair[::-1], mechanics=of)
    with pytest.raises(ValueError, match="mechanics: the bodies' contact has no friction"):
        qs.Contact(*pair, law=qs.Conductance(1.0, friction=0.5), mechanics=of, dt=1.0)
    for name, value in (("search_radius", 1.0), ("normals", "facet"), ("quadrature_degree", 2)):
        with pytest.raises(ValueError, match=f"{name}: leave it out"):
            qs.Contact(*pair, mechanics=of, **{name: value})
    alone = qs.Contact(*pair)
    with pytest.raises(qs.ConvergenceError, match="nothing may hold the field"):
        heated = scene.F[0] - 1.0 * ufl.TestFunction(scene.spaces[0]) * ufl.dx
        qs.ContactProblem([heated, scene.F[1]], scene.T, [alone]).solve()


def test_refused():
    scene = Pressed()
    slave, master = scene.surfaces
    with pytest.raises(ValueError, match="law: scalar fields have no gaps"):
        qs.Contact(slave, master, law=qs.Unilateral())
    with pytest.raises(ValueError, match="slave and master: both or none must be on scalar"):
        qs.Contact(slave, scene.contact.master)
    with pytest.raises(ValueError, match="mechanics: must be the bodies' contact"):
        qs.Contact(slave, master, law=qs.Conductance(lambda p, g: p))
    with pytest.raises(ValueError, match="Conductance is for surfaces on scalar"):
        qs.Contact(scene.contact.slave, scene.contact.master, law=qs.Conductance(1.0))
    with pytest.raises(ValueError, match="friction: scalar fields have none"):
        qs.Contact(slave, master, friction=qs.Coulomb(0.1))
    with pytest.raises(ValueError, match="h: must be a number that is not negative"):
        qs.Conductance(-1.0)
    with pytest.raises(ValueError, match=r"h: must be a function of \(p, g\)"):
        qs.Conductance(lambda p: p)
    with pytest.raises(ValueError, match="sliding: leave it out"):
        qs.Contact(slave, master, sliding="finite")
    die = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    with pytest.raises(ValueError, match="law: a rigid tool has no field"):
        qs.Contact(slave, die)
    with pytest.raises(ValueError, match="needs tool="):
        qs.Contact(slave, die, law=qs.Conductance(1.0))
    with pytest.raises(ValueError, match="mechanics: exchange slave and master"):
        qs.Contact(master, slave, law=qs.Conductance(1.0), mechanics=scene.contact)
    contact = qs.Contact(slave, master)
    with pytest.raises(ValueError, match=r"use contact.flow\(side\)"):
        contact.force("slave")
    with pytest.raises(ValueError, match=r"use contact.force\(side\)"):
        scene.contact.flow("slave")
