"""Test elasto-plastic bodies: closed forms, invariances, balances, and errors."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, box, plane, slide, vector_space
from tangents import direction, near_solution, tangent_errors

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.steps.mesh_motion import MeshMotion

E, NU, YIELD, HARDENING = 200e3, 0.3, 700.0, 300.0
G, K = E / 2 / (1 + NU), E / 3 / (1 - 2 * NU)
KINDS = ("plane", "axisymmetric", "3D")
PLACES = {2: ([0, 1, 2, 0], [0, 1, 2, 1]), 3: ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])}


def scene(kind, n=2, mixed=False, degree=2):
    """A displacement-based body of degree 1, or with the MINI element."""
    if kind == "3D":
        msh = box(WORLD, (n,) * 3, "tetrahedron", [0.0] * 3, [1.0] * 3)
    else:
        msh = box(WORLD, (n, n), "triangle", [0.0] * 2, [1.0] * 2)
    w = fem.Function(materials.mini_space(msh) if mixed else vector_space(msh))
    axisymmetric = kind == "axisymmetric"
    return qs.J2Plasticity(w, E, NU, YIELD, HARDENING, axisymmetric=axisymmetric, degree=degree)


def deform(body, F):
    """Set the displacement of a uniform deformation."""
    gdim = body.mesh.geometry.dim
    body.w.interpolate(lambda x: (F - np.eye(3))[:gdim, :gdim] @ x[:gdim])


def tensors(field, gdim):
    """Return symmetric tensors at all points of this rank."""
    rows, columns = PLACES[gdim]
    values = field.x.array.reshape(-1, len(rows))
    out = np.zeros((len(values), 3, 3))
    out[:, rows, columns] = out[:, columns, rows] = values
    return out


def integral(body, f):
    value = fem.assemble_scalar(fem.form(f * body.dx))
    return WORLD.allreduce(value)


def of_eigenvalues(function, A):
    values, vectors = np.linalg.eigh(A)
    return (vectors * function(values)) @ vectors.T


class Point:
    """The same material at a point, with the logarithm and the exponential by eigenvalues."""

    def __init__(self):
        self.F, self.e, self.alpha = np.eye(3), np.zeros((3, 3)), 0.0

    def step(self, F):
        f = F @ np.linalg.inv(self.F)
        e = of_eigenvalues(np.log, f @ of_eigenvalues(np.exp, 2 * self.e) @ f.T) / 2
        mean = np.trace(e) / 3 * np.eye(3)
        mises = np.sqrt(6) * G * np.linalg.norm(e - mean)
        flow = max(0.0, mises - YIELD - HARDENING * self.alpha) / (3 * G + HARDENING)
        self.F, self.alpha = F, self.alpha + flow
        self.e = mean + (1 - 3 * G * flow / mises) * (e - mean)


def paths(kind, rng):
    """Return uniform deformations with increments of some per cent, and then ten times smaller."""
    F = np.eye(3)
    for size in (*[0.05] * 6, *[0.002] * 3):
        change = size * rng.normal(size=(3, 3))
        if kind == "plane":
            change[2] = change[:, 2] = 0
        if kind == "axisymmetric":
            change[0, 1] = 0
            change[2], change[:, 2] = 0, 0
            change[2, 2] = change[0, 0]
        F = (np.eye(3) + change) @ F
        yield F


@pytest.mark.parametrize("kind", KINDS)
def test_any_path(kind):
    """Along paths with shear and rotation: as by eigenvalues; plastic flow keeps the volume."""
    body, point = scene(kind), Point()
    for F in paths(kind, np.random.default_rng(1)):
        deform(body, F)
        body.update()
        point.step(F)
        e = tensors(body.elastic_strain, body.mesh.geometry.dim)
        assert np.abs(e - point.e).max(initial=0) < 1e-9
        assert np.abs(body.plastic_strain.x.array - point.alpha).max(initial=0) < 1e-9
        volume = np.exp(np.trace(e, axis1=1, axis2=2))
        assert np.abs(volume - np.linalg.det(F)).max(initial=0) < 1e-9
    assert 0.2 < point.alpha < 1


def test_large_steps():
    """The errors of the logarithm are those stated in the class."""
    for stretch, error in ((0.9, 1e-10), (0.75, 1e-6), (1.33, 1e-6), (0.5, 1e-3), (2.0, 1e-3)):
        body = scene("3D", n=1)
        deform(body, np.diag([stretch**-0.5, stretch**-0.5, stretch]))
        body.update()
        flow = (3 * G * abs(np.log(stretch)) - YIELD) / (3 * G + HARDENING)
        found = body.plastic_strain.x.array
        assert np.abs(found / flow - 1).max(initial=0) < 1.1 * error


@pytest.mark.parametrize("kind", ("plane", "3D"))
def test_turning(kind):
    """If a body is rotated, by any angle in a step, its stress rotates and it does not yield."""
    body = scene(kind)
    gdim = body.mesh.geometry.dim
    F = np.array([[1.1, 0.08, 0], [0.02, 0.9, 0], [0, 0, 1.0]])
    deform(body, F)
    body.update()
    e, alpha = tensors(body.elastic_strain, gdim), body.plastic_strain.x.array.copy()
    turned = np.eye(3)
    for angle in (1e-3, 0.5, np.pi / 2, 2.5):
        c, s = np.cos(angle), np.sin(angle)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ turned
        deform(body, turned @ F)
        body.update()
        found = tensors(body.elastic_strain, gdim)
        # Unloaded by rounding, or loaded: plastic flow of the order of rounding.
        assert np.abs(found - turned @ e @ turned.T).max(initial=0) < 1e-13
        assert np.abs(body.plastic_strain.x.array - alpha).max(initial=0) < 1e-13
    assert alpha.min(initial=1) > 0.05


class Held:
    """A body between z = 0 and a moving plate z = 1.

    Args:
        body: The body.
        sticking: Whether it sticks to both; otherwise to neither, and it is fixed at x, y = 0.
    """

    def __init__(self, body, sticking=False):
        self.body, msh = body, body.mesh
        V = body.w.function_space.sub(0) if body.mixed else body.w.function_space
        up = msh.geometry.dim - 1
        lower, upper = plane(msh, up, 0.0), plane(msh, up, 1.0)
        self.top = fem.Constant(msh, 0.0)
        dofs = fem.locate_dofs_topological(V.sub(up), up, upper)
        bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in range(up + 1)]
        if sticking:
            bcs += [slide(V, axis, facets) for axis in range(up) for facets in (lower, upper)]
        bcs.append(fem.dirichletbc(self.top, dofs, V.sub(up)))
        self.problem = qs.ContactProblem([body.residual], [body.w], [], [bcs])
        lift = fem.Function(body.w.function_space)
        slide(V, up, upper, 1.0).set(lift.x.array)
        self.virtual_work = fem.form(ufl.action(body.residual, lift))
        self.stretch = fem.Function(body.w.function_space)
        part = self.stretch.sub(0) if body.mixed else self.stretch
        part.interpolate(lambda x: np.arange(up + 1)[:, None] // up * x[up])

    def solve(self, height):
        """Return the force of the plate that pulls at z = 1. Collective."""
        # Start from a uniform stretch: otherwise one row of cells yields first in Newton's method.
        self.body.w.x.array[:] += (height - 1 - self.top.value) * self.stretch.x.array
        self.top.value = height - 1
        self.problem.solve()
        return WORLD.allreduce(fem.assemble_scalar(self.virtual_work))


@pytest.mark.parametrize("mixed", (False, True))
@pytest.mark.parametrize("kind", ("axisymmetric", "3D"))
def test_uniaxial(kind, mixed):
    """Logarithmic strain ε = τ/E + α and |τ| = σ_Y + H α: loading, unloading, reverse loading."""
    body = scene(kind, mixed=mixed, degree=4 if mixed else 2)
    held = Held(body)
    alpha = strain = stress = 0.0
    up, area = body.mesh.geometry.dim - 1, np.pi if kind == "axisymmetric" else 1.0
    for height in (1.002, 1.05, 1.1, 1.099, 1.05, 1.0):
        force = held.solve(height)
        trial = stress + E * (np.log(height) - strain)
        flow = max(0.0, abs(trial) - YIELD - HARDENING * alpha) / (E + HARDENING)
        stress, strain = trial - E * flow * np.sign(trial), np.log(height)
        tau = np.zeros((3, 3))
        tau[up, up] = stress
        difference = body.kirchhoff_stress - ufl.as_tensor(tau.tolist())
        error = integral(body, ufl.inner(difference, difference)) / integral(body, 1.0)
        assert np.sqrt(error) < 1e-6 * YIELD
        assert np.isclose(force, area * stress / height, rtol=1e-6)  # τ is work per volume
        body.update()
        alpha += flow
        assert np.abs(body.plastic_strain.x.array - alpha).max(initial=0) < 1e-8
    assert alpha > 0.15
    held.problem.destroy()


@pytest.mark.parametrize("kind", ("axisymmetric", "3D"))
def test_energy(kind):
    """The plate's work is stored and dissipated, up to the error of its summation rule."""
    errors = []
    for steps in (4, 8):
        body = scene(kind, mixed=True, degree=4)
        held = Held(body, sticking=True)
        heights = np.concatenate([[0.99, 0.98], np.linspace(0.97, 0.8, steps + 1)])
        forces, energies = [], []
        for height in heights:
            forces.append(held.solve(height))
            energies.append([body.stored_energy(), body.dissipated_energy()])
            body.update()
        work = np.sum((np.array(forces[2:-1]) + forces[3:]) / 2 * np.diff(heights[2:]))
        stored, dissipated = np.array(energies[-1]) - energies[2]
        assert 0 < stored < 0.2 * dissipated
        errors.append(abs(1 - (stored + dissipated) / work))
        held.problem.destroy()
    assert errors[1] < 0.6 * errors[0] < 0.01, errors


@pytest.mark.parametrize("mixed", (False, True))
@pytest.mark.parametrize("kind", KINDS)
def test_tangent(kind, mixed):
    """The tangent is the derivative, and symmetric, where only a part of the body yields."""
    body = scene(kind, n=2, mixed=mixed, degree=4 if mixed else 2)
    held = Held(body, sticking=True)
    for height in (0.95, 0.9):
        held.solve(height)
        body.update()
    held.solve(0.8985)
    rng = np.random.default_rng(3)
    if mixed:
        x = held.problem.system.x.copy()
    else:
        x = near_solution(held.problem, rng, 1e-3)
    errors = tangent_errors(held.problem, x, direction(held.problem, rng), 1e-8)
    assert errors.difference < 1e-5 and errors.asymmetry < 1e-9, errors
    held.problem.destroy()


@pytest.mark.parametrize("kind", KINDS)
def test_from_the_deformed_mesh(kind):
    """The state on the deformed mesh gives the same as continuing from the first mesh."""
    bodies = [scene(kind, n=3) for _ in range(2)]
    for body in bodies:
        held = Held(body, sticking=True)
        for height in (0.95, 0.9):
            held.solve(height)
            body.update()
        held.problem.destroy()
    whole, moved = bodies
    held = Held(whole, sticking=True)
    held.top.value = -0.1
    held.solve(0.85)
    end = whole.w.x.array.copy()

    held = Held(moved, sticking=True)
    start = moved.w.x.array.copy()
    motion = MeshMotion(moved.w)
    motion.move(motion.values())
    moved.w.x.array[:] = 0
    moved.restart()
    force = held.solve(0.95)
    assert force < 0
    assert np.abs(start + moved.w.x.array - end).max(initial=0) < 1e-8


@pytest.mark.parametrize("mixed", (False, True))
@pytest.mark.parametrize("kind", KINDS)
def test_at_rest(kind, mixed):
    """Solved again on the deformed mesh, a body under a die stays in place, with the same force."""
    body = scene(kind, mixed=mixed, degree=4 if mixed else 2)
    msh, gdim = body.mesh, body.mesh.geometry.dim
    V = body.w.function_space.sub(0) if mixed else body.w.function_space
    facets, up = plane(msh, gdim - 1, 1.0), [0.0] * (gdim - 1) + [1.0]
    held = [plane(msh, axis, 0.0) for axis in range(gdim)]

    def solve(height):
        die = qs.RigidSurface.plane(WORLD, np.array(up) * height, -np.array(up))
        surface = qs.Surface(V, facets=facets, axisymmetric=kind == "axisymmetric")
        contact = qs.Contact(surface, die, penalty=1e3 * E)
        bcs = [slide(V, axis, facets) for axis, facets in enumerate(held)]
        problem = qs.ContactProblem([body.residual], [body.w], [contact], [bcs])
        problem.solve()
        body.update()
        force = contact.force("slave")[-1]
        problem.destroy()
        return force

    force = solve(0.96)
    assert force < 0
    for _ in range(2):
        motion = MeshMotion(body.w)
        motion.move(motion.values())
        body.w.x.array[:] = 0
        body.restart()
        assert np.isclose(solve(0.96), force, rtol=1e-8)
        displacement = body.w.sub(0).collapse() if mixed else body.w
        assert np.abs(displacement.x.array).max(initial=0.0) < 1e-8


@pytest.mark.parametrize("mixed", (False, True))
def test_goes_on_from_a_checkpoint(mixed, tmp_path):
    """Saved half way and loaded into another body of the same mesh: all digits agree."""
    folder = WORLD.bcast(str(tmp_path / "run"))

    def run():
        body = scene("axisymmetric", n=3, mixed=mixed, degree=4 if mixed else 2)
        msh = body.mesh
        V = body.w.function_space.sub(0) if mixed else body.w.function_space
        die = qs.RigidSurface.plane(WORLD, point=[0, 1], normal=[0, -1])
        top = qs.Surface(V, facets=plane(msh, 1, 1.0), axisymmetric=True)
        contact = qs.Contact(top, die, friction=qs.Tresca(50.0), penalty=1e3 * E)
        bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in (0, 1)]
        problem = qs.ContactProblem([body.residual], [body.w], [contact], [bcs])

        def drive(t, dt):
            die.displacement = [0, -0.1 * dt if t < 0.7 else 0.02 * dt]

        return body, contact, qs.TimeStepper(problem, 0.1, drive)

    body, contact, stepper = run()
    for t in stepper.run(1.0):
        body.update()
        if np.isclose(t, 0.5):
            qs.save_run(stepper, folder, body.state)
            with pytest.warns(qs.ContactWarning, match="'volume' of u"):
                qs.save_run(stepper, folder + "-less", body.fields)
    force, strain = contact.force("slave")[1], body.plastic_strain.x.array.copy()
    body, contact, stepper = run()
    qs.load_run(stepper, folder, body.state)
    body.resume()
    for _ in stepper.run(1.0):
        body.update()
    assert np.isclose(contact.force("slave")[1], force, rtol=1e-7)
    assert np.abs(body.plastic_strain.x.array - strain).max(initial=0.0) < 1e-8


def test_pressed_by_a_die():
    """A cylinder under a plane without friction, in time steps: F = π R² |τ| h₀ / h."""
    body = scene("axisymmetric", n=3, mixed=True, degree=4)
    msh, V = body.mesh, body.w.function_space.sub(0)
    die = qs.RigidSurface.plane(WORLD, point=[0, 1], normal=[0, -1])
    top = qs.Surface(V, facets=plane(msh, 1, 1.0), axisymmetric=True)
    contact = qs.Contact(top, die, quadrature="nodal")
    bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in (0, 1)]
    problem = qs.ContactProblem([body.residual], [body.w], [contact], [bcs])

    def drive(t, dt):
        die.displacement = [0, -0.3 * dt]

    stepper = qs.TimeStepper(problem, 0.1, drive)
    for t in stepper.run(1.0):
        body.update()
        strain = -np.log(1 - 0.3 * t)
        stress = YIELD + HARDENING * (E * strain - YIELD) / (E + HARDENING)
        force = np.pi * stress / (1 - 0.3 * t)
        assert np.isclose(-contact.force("slave")[1], force, rtol=1e-6)
    problem.destroy()


def test_what_is_refused():
    msh = box(WORLD, (2, 2), "triangle", [0.0] * 2, [1.0] * 2)
    w, scalar = fem.Function(vector_space(msh)), fem.Function(fem.functionspace(msh, ("DG", 0)))
    good = (E, NU, YIELD, HARDENING)
    for values, name in (((0.0, NU, YIELD, HARDENING), "E"), ((E, 0.5, YIELD, HARDENING), "nu"),
                         ((E, NU, 0.0, HARDENING), "yield_stress"),
                         ((E, NU, YIELD, -1.0), "hardening")):  # fmt: skip
        with pytest.raises(ValueError, match=rf"^{name}: "):
            qs.J2Plasticity(w, *values)
    with pytest.raises(ValueError, match=r"^w: "):
        qs.J2Plasticity(scalar, *good)
    with pytest.raises(TypeError, match=r"^w: "):
        qs.J2Plasticity(ufl.as_vector([w[0], w[1]]), *good)
    with pytest.raises(ValueError, match=r"^degree: "):
        qs.J2Plasticity(w, *good, degree=0)
    solid = fem.Function(vector_space(box(WORLD, (1,) * 3, "tetrahedron", [0.0] * 3, [1.0] * 3)))
    with pytest.raises(ValueError, match=r"^axisymmetric: "):
        qs.J2Plasticity(solid, *good, axisymmetric=True)


@pytest.mark.parametrize(("kind", "warns"), (("quadrilateral", True), ("triangle", False)))
def test_reduced_quadrature(kind, warns):
    """Two points per direction miss deformations of quadrilaterals of degree 2; four do not."""
    msh = box(WORLD, (2, 2), kind, [0.0] * 2, [1.0] * 2)
    w = fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2,))))
    for degree in (2, 4):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            body = qs.J2Plasticity(w, E, NU, YIELD, HARDENING, degree=degree)
        matrix = fem.assemble_matrix(fem.form(ufl.derivative(body.residual, w))).to_dense()
        if WORLD.size == 1:
            values = np.abs(np.linalg.eigvalsh(matrix))
            assert (np.sum(values < 1e-8 * values.max()) > 3) == (warns and degree == 2)
        assert any("degree" in str(c.message) for c in caught) == (warns and degree == 2)
