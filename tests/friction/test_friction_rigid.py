"""Friction on analytic or faceted rigid tools, moved and rotated; displacements, velocities.

A block held at its bottom is pressed by a tool on its top and dragged by the tool.
"""

import numpy as np
import pytest
from rigid_scenes import TOOLS
from scenes import WORLD, box, clamp, elastic, largest, plane, slide

import ufl
from dolfinx import fem

import qsdolfinx as qs

MU, PRESS = 0.3, 0.02
SAMPLINGS = {
    "nodal": {"quadrature": "nodal", "formulation": "master-slave"},
    "overlay": {"quadrature": "overlay", "constraints": "nodes"},
    "points": {"quadrature": "overlay", "constraints": "points"},
}
AUGMENTED = {"enforcement": "augmented-lagrangian"}


class Scene:
    """Elastic unit block, held at its bottom, and a tool at its top."""

    def __init__(self, cell, kind="analytic", sampling="nodal", n=3, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.mesh = box(WORLD, [n] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
        bottom, top = (plane(self.mesh, gdim - 1, z) for z in (0.0, 1.0))
        self.tool = TOOLS[kind](WORLD, gdim)
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (gdim,)))
        self.u = fem.Function(self.V)
        self.contact = qs.Contact(
            qs.Surface(self.V, facets=top),
            self.tool,
            **(SAMPLINGS[sampling] | {"friction": qs.Coulomb(MU)} | options),
        )
        forms = [elastic(self.u, E=7.0)]
        bcs = [[clamp(self.V, bottom)]]
        self.problem = qs.ContactProblem(forms, [self.u], [self.contact], bcs)

    def at_nodes(self, function):
        """Return values at the surface's nodes of this rank."""
        surface = self.contact.slave
        first = surface.V.dofmap.index_map.local_range[0] * self.gdim
        return function.x.array[surface.node_dofs - first]


def along(gdim, angle):
    """Return a horizontal unit vector."""
    return np.array([1.0, 0.0] if gdim == 2 else [np.cos(angle), np.sin(angle), 0.0])


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("kind", TOOLS)
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_full_slip(cell, kind, sampling):
    """Friction is μ times the load along the tool's motion; the tool has the opposite force."""
    scene = Scene(cell, kind, sampling)
    d, way = scene.gdim, along(scene.gdim, 0.4)
    down = -PRESS * np.eye(d)[-1]
    forces, shares = [], []
    for shift in (0.0, 0.002, 0.2, 0.4, 0.6, 0.8):
        scene.tool.displacement = down + shift * way
        scene.problem.solve()
        force, moment = (getattr(scene.contact, name)("slave") for name in ("force", "moment"))
        forces.append(force)
        active = WORLD.allreduce(int(scene.contact.active().sum()))
        shares.append(WORLD.allreduce(int(scene.contact.slipping().sum())) / active)
        np.testing.assert_array_equal(scene.contact.force("master"), -force)
        np.testing.assert_array_equal(scene.contact.moment("master"), -moment)
    pressed = -forces[-1][-1]
    assert pressed > 0.05 and shares[1] < 1 and shares[-1] == 1
    assert 0 < forces[1] @ way < 0.9 * MU * -forces[1][-1]
    np.testing.assert_allclose(forces[-1][:-1], MU * pressed * way[:-1], atol=1e-6 * pressed)


@pytest.mark.parametrize("kind", TOOLS)
@pytest.mark.parametrize("angle", (0.4, -0.4))
def test_spin(kind, angle):
    """For a tool that spins about the vertical, slip and friction circle around its axis."""
    scene = Scene("hexahedron", kind, "overlay", n=4)
    scene.tool.displacement = [0.0, 0.0, -PRESS]
    scene.problem.solve()
    before = scene.at_nodes(scene.u), scene.contact.slip()
    scene.tool.rotation = [0.0, 0.0, angle]
    scene.problem.solve()
    contact, x = scene.contact, scene.contact.slave.node_x
    A, b = scene.tool.motion
    moved = (x @ A.T + b)[:, :2]
    expected = (scene.at_nodes(scene.u) - before[0])[:, :2] - moved
    slip = (contact.slip() - before[1])[:, :2]
    friction = scene.at_nodes(contact.traction("slave", part="tangential"))[:, :2]
    far = np.linalg.norm(x[:, :2] - 0.5, axis=1) > 0.3
    cosine = [
        np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        for a, b in ((slip[far], expected[far]), (friction[far], moved[far]))
    ]
    least = [-largest(-1 + c) for c in cosine]
    moment, force = contact.moment("slave", [0.5, 0.5, 1.0]), contact.force("slave")
    assert least[0] > -0.03 and least[1] > -0.1
    # A uniform pressure on a square gives μ N times the mean distance from the axis, 0.3826.
    assert np.isclose(moment[2], np.sign(angle) * MU * -force[2] * 0.3826, rtol=0.2)
    assert np.linalg.norm(force[:2]) < 0.02 * MU * -force[2]


@pytest.mark.parametrize("kind", TOOLS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_steps(cell, kind):
    """Solves without contact updates and time steps with them have the same totals.

    Constraints are at nodes, with an augmented Lagrangian: its forces do not depend on the current
    facet sizes.
    """
    results = []
    for stepping in (False, True):
        scene = Scene(cell, kind, quadrature="nodal", **AUGMENTED)
        d = scene.gdim
        path = [-PRESS * np.eye(d)[-1] + s * along(d, 0.4) for s in (0.0, 0.01, 0.05, 0.2, 0.15)]
        tool, forces = scene.tool, []
        if stepping:

            def drive(t, dt, path=path, tool=tool):
                step = round(t)
                tool.displacement = path[step - 1] - (path[step - 2] if step > 1 else 0.0)

            stepper = qs.TimeStepper(scene.problem, 1.0, drive)
        for i, goal in enumerate(path):
            if stepping:
                stepper.step(i + 1.0)
            else:
                tool.displacement = goal
                scene.problem.solve()
            forces.append(scene.contact.force("slave"))
        slip = scene.contact.slip()
        total = WORLD.allreduce(slip.T @ slip)
        results.append((np.array(forces), scene.contact.dissipated_energy(), total))
    forces = results[0][0]
    assert forces[1][0] > 0 and forces[3][0] > 0 > forces[4][0] and results[0][1] > 1e-3
    # Energies: pressures at the start of a step are those of the facets at that contact update.
    for plain, stepped, rtol in zip(*results, (1e-5, 1e-3, 1e-5), strict=True):
        np.testing.assert_allclose(stepped, plain, rtol=rtol, atol=1e-7)


# --- Velocities


class Shear:
    """Newtonian slab, 1 × h, on a plate at rest; a tool on its top moves along x.

    The sides have the pressure P and no vertical velocity: the flow is simple shear.
    """

    H, P, DT = 0.5, 2.0, 0.1

    def __init__(self, viscosity, friction, **options):
        msh = box(WORLD, [3, 2], "triangle", [0.0, 0.0], [1.0, self.H], "scattered")
        W = qs.materials.mini_space(msh)
        self.w, V = fem.Function(W), W.sub(0)
        stress = qs.materials.newtonian(ufl.split(self.w)[0], viscosity)
        v = ufl.TestFunctions(W)[0]
        n = ufl.FacetNormal(msh)
        load = self.P * n[0] ** 2 * ufl.inner(n, v) * ufl.ds  # on the lateral sides
        F = qs.materials.incompressible(self.w, stress) + load
        bcs = [slide(V, i, plane(msh, 1, 0.0)) for i in (0, 1)]
        bcs += [slide(V, 1, plane(msh, 0, x)) for x in (0.0, 1.0)]
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, self.H], [0.0, -1.0])
        surface = qs.Surface(V, facets=plane(msh, 1, self.H))
        options = {"unknown": "velocity", "dt": self.DT, **AUGMENTED} | options
        self.contact = qs.Contact(surface, self.tool, friction=friction, **options)
        self.problem = qs.ContactProblem([F], [self.w], [self.contact], [bcs])

    def drag(self, speed):
        self.tool.displacement = [speed * self.DT, 0.0]
        self.problem.solve()
        return self.contact.force("slave")


def test_viscous_slab():
    """Norton friction of a slab on a plate has a closed form: K γ̇ = α K_f (V − γ̇ h)^q."""
    viscosity, alpha, Kf, speed = 3.0, 0.4, 5.0, 2.0
    for q in (1.0, 0.5, 0.15):
        scene = Shear(viscosity, qs.Norton(alpha, Kf, q, v0=1e-6))
        force = scene.drag(speed)
        rate, high = 0.0, speed / Shear.H
        for _ in range(60):  # bisection for the slip rate
            middle = (rate + high) / 2
            grows = viscosity * middle < alpha * Kf * (speed - middle * Shear.H) ** q
            rate, high = (middle, high) if grows else (rate, middle)
        v = scene.w.sub(0).collapse()
        x = v.function_space.tabulate_dof_coordinates()
        vertices = v.x.array.reshape(-1, 2)[: len(x)]
        top = np.isclose(x[:, 1], Shear.H)
        slip = scene.contact.slip()[:, 0] / Shear.DT
        dissipated = scene.contact.dissipated_energy()
        assert 0 < rate < speed / Shear.H
        assert np.isclose(force[0], viscosity * rate, rtol=1e-7)
        assert largest(vertices[top, 0] - rate * Shear.H) < 1e-7
        assert largest(vertices[:, 1]) < 1e-7
        assert largest(slip + speed - rate * Shear.H) < 1e-7
        taken = viscosity * rate * (speed - rate * Shear.H) * Shear.DT
        assert np.isclose(dissipated, taken, rtol=1e-7)


@pytest.mark.parametrize("q", (1.0, 0.3))
def test_stiff_slab(q):
    """On a slab that hardly flows τ = α K V^q, also in time steps."""
    scene = Shear(1e8, qs.Norton(0.4, 5.0, q, v0=1e-6))

    def drive(t, dt):
        scene.tool.displacement = [2.0 * dt, 0.0]

    stepper = qs.TimeStepper(scene.problem, Shear.DT, drive)
    for i in range(3):
        stepper.step((i + 1) * Shear.DT)
        force = scene.contact.force("slave")
        assert np.isclose(force[0], 0.4 * 5.0 * 2.0**q, rtol=1e-6)
    energy = scene.contact.dissipated_energy()
    assert np.isclose(energy, 3 * 0.4 * 5.0 * 2.0 ** (q + 1) * Shear.DT, rtol=1e-6)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_coulomb_in_velocities(enforcement):
    """Slow tools drag the slab along; fast ones slip, and friction is μ times the load."""
    scene = Shear(3.0, qs.Coulomb(MU), enforcement=enforcement)
    slow, fast = scene.drag(0.01), scene.drag(3.0)
    slipping = WORLD.allreduce(int(scene.contact.slipping().sum()))
    assert slow[1] < -1 and 0 < slow[0] < 0.5 * MU * -slow[1]
    assert slipping > 0 and np.isclose(fast[0], MU * -fast[1], rtol=1e-9)
    np.testing.assert_array_equal(scene.contact.force("master"), -fast)


@pytest.mark.parametrize("kind", TOOLS)
def test_flow_in_steps(kind):
    """A Newtonian block upset and dragged with contact updates: friction is μ times the load."""
    msh = box(WORLD, [4, 4], "triangle", [0.0, 0.0], [1.0, 1.0], "scattered")
    W = qs.materials.mini_space(msh)
    w, V = fem.Function(W), W.sub(0)
    F = qs.materials.incompressible(w, qs.materials.newtonian(ufl.split(w)[0], 3.0))
    bcs = [slide(V, i, plane(msh, 1, 0.0)) for i in (0, 1)]
    tool = TOOLS[kind](WORLD, 2)
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    options = {"unknown": "velocity", "dt": 0.05, "friction": qs.Coulomb(0.1)} | AUGMENTED
    contact = qs.Contact(surface, tool, formulation="master-slave", gap_tolerance=1e-10, **options)
    problem = qs.ContactProblem([F], [w], [contact], [bcs])

    def drive(t, dt):
        tool.displacement = [4.0 * dt, -0.5 * dt]

    stepper = qs.TimeStepper(problem, 0.05, drive)
    energies = [0.0]
    for i in range(4):
        stepper.step((i + 1) * 0.05)
        force = contact.force("slave")
        slipping, active = (
            WORLD.allreduce(int(f().sum())) for f in (contact.slipping, contact.active)
        )
        energies.append(contact.dissipated_energy())
        assert slipping == active > 0
        assert np.isclose(force[0], 0.1 * -force[1], rtol=1e-8) and force[1] < -1
        np.testing.assert_array_equal(contact.force("master"), -force)
    assert np.all(np.diff(energies) > 0)
