"""Bodies rotated and translated as a whole: all results rotate with them."""

import numpy as np
import pytest
from following import Body, Nested, on_radius, problem_of, ring, rotation
from rigid_scenes import grid_cells
from scenes import FORMULATIONS, WORLD, Pair, box, elevated, largest, plane
from tangents import full_steps

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.system.equations import Equations

ANGLES = (30.0, 90.0)
AXIS = {2: None, 3: (0.5, -0.3, 0.7)}
SIZES = {
    "triangle": (13, 17),
    "quadrilateral": (13, 17),
    "tetrahedron": (2, 3),
    "hexahedron": (2, 3),
}


class Turned:
    """Two rings or two shells, twisted against each other, that are rotated together."""

    def __init__(self, cell, mu=0.0, repeat=12, misfit=None, **contact):
        friction = qs.Coulomb(mu) if mu else None
        misfit = misfit or (0.05 if cell in ("triangle", "quadrilateral") else 0.15)
        self.scene = scene = Nested(
            cell, n=SIZES[cell], misfit=misfit, friction=friction, **contact
        )
        self.gdim, self.contact, self.bodies = scene.gdim, scene.contact, scene.bodies
        self.held = []
        for body, far in zip(scene.bodies, scene.far, strict=True):
            held = fem.Function(body.V)
            dofs = fem.locate_dofs_topological(body.V, self.gdim - 1, far)
            body.bcs[:] = [fem.dirichletbc(held, dofs)]
            self.held.append(held)
        twist = rotation(0.03, None if self.gdim == 2 else (0.2, 0.3, 1.0))
        self.held[0].interpolate(lambda x: (twist - np.eye(self.gdim)) @ x[: self.gdim] + 0.01)
        self.problem = scene.problem(solver="direct")
        for _ in range(repeat):  # until areas, which are weights of a penalty, have converged
            self.problem.solve()
            if self.problem.num_iterations == 0:
                break

    @property
    def forces(self):
        return [body.internal_forces() for body in self.bodies]

    def turn(self, degrees):
        """Move all unknowns rigidly and solve again; return the matrix."""
        R = rotation(np.radians(degrees), AXIS[self.gdim])
        shift = 0.7 * np.arange(1, self.gdim + 1)
        for body, held in zip(self.bodies, self.held, strict=True):
            x = body.V.tabulate_dof_coordinates()[:, : self.gdim]
            u = body.u.x.array.reshape(-1, self.gdim)
            u[:] = (x + u) @ R.T + shift - x
            held.x.array[:] = body.u.x.array
        self.problem.solve()
        return R


PENALTY = {"enforcement": "penalty", "penalty": 300.0}


@pytest.mark.parametrize(
    ("cell", "options"),
    [
        *(("quadrilateral", {"formulation": formulation}) for formulation in FORMULATIONS),
        ("triangle", PENALTY),
        ("tetrahedron", PENALTY),
        ("tetrahedron", {**PENALTY, "formulation": "master-slave"}),
    ],
)
@pytest.mark.parametrize("degrees", ANGLES)
def test_without_friction(cell, options, degrees):
    scene = Turned(cell, **options)
    forces, contact = scene.forces, scene.contact
    gap, pressure = contact.weighted_gap(), contact.multiplier()
    R = scene.turn(degrees)
    size = largest(*forces)
    changes = [new - old @ R.T for new, old in zip(scene.forces, forces, strict=True)]
    assert scene.problem.num_iterations <= 1
    assert largest(*changes) < 1e-10 * size
    assert largest(contact.weighted_gap() - gap) < 1e-10
    assert largest(contact.multiplier() - pressure) < 1e-9 * largest(pressure)


def test_warped_facets():
    """The same holds for warped quadrilaterals."""
    scene = Turned("hexahedron", **PENALTY)
    forces = scene.forces
    R = scene.turn(90.0)
    changes = [new - old @ R.T for new, old in zip(scene.forces, forces, strict=True)]
    assert largest(*changes) < 1e-8 * largest(*forces)


@pytest.mark.parametrize(
    ("cell", "degrees", "options"),
    [
        ("quadrilateral", 30.0, PENALTY),
        ("quadrilateral", 90.0, PENALTY),
        ("tetrahedron", 30.0, PENALTY),
        # Points move with the bodies; their part beyond that of the nodes rotates with their
        # normals, too.
        ("tetrahedron", 30.0, {"repeat": 1}),
    ],
)
def test_with_friction(cell, degrees, options):
    """Nothing slips, and tractions rotate along."""
    scene = Turned(cell, 0.3, **options)
    forces, contact = scene.forces, scene.contact
    tau, slip = contact.tangential_multiplier(), contact.slip()
    R = scene.turn(degrees)
    changes = [new - old @ R.T for new, old in zip(scene.forces, forces, strict=True)]
    tractions = contact.tangential_multiplier() - tau @ R.T
    assert scene.problem.num_iterations <= 2
    assert largest(*changes) < 1e-8 * largest(*forces)
    assert largest(tractions) < 1e-8 * largest(tau)
    assert abs(contact.step_dissipation()) < 1e-8
    assert largest(slip) > 0 or cell == "tetrahedron"  # where everything sticks


@pytest.mark.parametrize("faceted", (False, True))
def test_with_friction_on_a_tool(faceted):
    """The same holds on a rigid tool that has moved before it rotates with the body."""
    body = Body(box(WORLD, (4, 4), "quadrilateral", (0.0, 0.0), (1.0, 1.0), "scattered"))
    x = body.V.tabulate_dof_coordinates()[:, :2]
    held = fem.Function(body.V)
    bottom = fem.locate_dofs_topological(body.V, 1, plane(body.mesh, 1, 0.0))
    body.bcs.append(fem.dirichletbc(held, bottom))
    tool = qs.RigidSurface.plane(WORLD, [0.5, 2.0], [0.0, -1.0])
    if faceted:
        vertices = np.array([[-2.0, 2.0], [-0.3, 2.0], [0.6, 2.0], [3.0, 2.0]])
        given = (vertices, grid_cells(3, 2)) if WORLD.rank == 0 else (None, None)
        tool = qs.RigidSurface.triangulated(WORLD, *given, center=[0.5, 2.0])
    tool.position = [[1.0, 0.0, 0.0], [0.0, 1.0, -1.0]]
    options = {"sliding": "finite", "friction": qs.Coulomb(0.5), **PENALTY}
    contact = qs.Contact(body.side(1, 1.0), tool, **options)
    problem = problem_of([body], [contact], solver="direct")
    for tool.displacement in ([0.0, -0.02], [0.002, -0.02], [0.002, -0.02]):
        problem.solve()
    force, tau, R = contact.force("slave"), contact.tangential_multiplier(), rotation(0.8)
    there = tool.center + tool.displacement
    tool.rotation, tool.displacement = 0.8, R @ there - tool.center
    u = body.u.x.array.reshape(-1, 2)
    u[:] = (x + u) @ R.T - x
    held.x.array[:] = body.u.x.array
    problem.solve()
    assert 0.01 < largest(tau)
    assert largest(contact.force("slave") - R @ force) < 1e-6 * largest(force)
    assert largest(contact.tangential_multiplier() - tau @ R.T) < 1e-6 * largest(tau)
    assert abs(contact.step_dissipation()) < 1e-9


@pytest.mark.parametrize("mu", (0.0, 0.3))
def test_again(mu):
    """With multipliers, a solve without change directly after the first one ends at its start."""
    scene = Turned("quadrilateral", mu, repeat=1, misfit=0.02)
    forces = scene.forces
    scene.problem.solve()
    changes = [new - old for new, old in zip(scene.forces, forces, strict=True)]
    assert scene.problem.num_iterations == 0
    assert largest(*changes) == 0


@pytest.mark.parametrize("displacements", [1, 2])
def test_depth_of_curved_facets_that_slide(displacements):
    """Depths are those of the deformed bodies: a disc that rotates in its bore gets no deeper."""
    bodies = []
    for n, radii, turn in ((26, (0.6, 1.0), 0.0), (34, (0.98, 1.4), 0.3)):
        msh = elevated(ring((n, 1), radii, turn=turn))
        x = msh.geometry.x[:, :2]
        r = np.linalg.norm(x, axis=1)
        near = np.array((*radii, np.mean(radii)))[
            np.argmin(np.abs(r[:, None] - np.array((*radii, np.mean(radii)))), axis=1)
        ]
        x *= (near / r)[:, None]
        bodies.append(Body(msh, displacements))
    contact = qs.Contact(
        on_radius(bodies[0], 1.0, 0.01), on_radius(bodies[1], 0.98, 0.01),
        sliding="finite", enforcement="penalty", penalty=2000.0,
    )  # fmt: skip
    held = []
    for body, radius in zip(bodies, (0.6, 1.4), strict=True):
        far = body.boundary(lambda x, r=radius: np.abs(np.hypot(x[0], x[1]) / r - 1) < 0.01)
        held.append(fem.Function(body.V))
        body.bcs[:] = [fem.dirichletbc(held[-1], fem.locate_dofs_topological(body.V, 1, far))]
    problem, depths = problem_of(bodies, [contact]), []
    for angle in (0.0, 0.4, 0.8):
        held[0].interpolate(lambda x, a=angle: (rotation(a) - np.eye(2)) @ x[:2])
        bodies[0].u.interpolate(held[0])
        problem.solve()
        depths.append(contact.penetration())
    assert 1e-4 < depths[0] < 0.02
    assert depths[1:] == pytest.approx(2 * [depths[0]], rel=0.2)


class Dragged:
    """Hyperelastic blocks, pressed and dragged in a first step, and turned together in a second."""

    def __init__(self, cell, angle, **options):
        options = {"sliding": "finite", "friction": qs.Coulomb(1.0)} | options
        self.pair = pair = Pair(cell, contact_options=options, wave=0.02)
        self.gdim, self.held = pair.gdim, []
        self.R = rotation(angle, None if pair.gdim == 2 else (0.2, 1.0, 0.4))
        for i, (V, u) in enumerate(zip(pair.V, pair.u, strict=True)):
            stress = materials.neo_hookean(u, 1.0 + i, 1.0 + i)
            pair.F[i] = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
            far = plane(pair.meshes[i], pair.gdim - 1, 2.0 * i - 1.0)
            held = fem.Function(V)
            dofs = fem.locate_dofs_topological(V, pair.gdim - 1, far)
            pair.bcs[i][:] = [fem.dirichletbc(held, dofs)]
            self.held.append(held)
        self.problem = pair.problem(solver="direct")
        self.stepper = qs.TimeStepper(self.problem, 1.0, lambda t, dt: self.drive(t))

    def drive(self, t):
        """Set the positions of the held sides at the end of step t."""
        shift = np.zeros((self.gdim, 1))
        shift[[0, -1], 0] = 0.06, -0.05
        R = self.R if t > 1.5 else np.eye(self.gdim)
        for i, held in enumerate(self.held):
            held.interpolate(lambda x, i=i: R @ (x[: self.gdim] + i * shift) - x[: self.gdim])


@pytest.mark.parametrize("options", ({}, {"friction_penalty": 30.0}))
@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_quadratic_end(cell, options):
    """Newton's method ends quadratically where bodies turn with friction left from the last step.

    Forces turn with the bodies.
    """
    scene = Dragged(cell, np.radians(15.0), **options)
    scene.stepper.step()
    force = scene.pair.contact.force("slave")
    scene.drive(2.0)
    scene.problem.solve()
    turned = scene.pair.contact.force("slave")
    assert abs(force[0]) > 0.1 * abs(force[-1])
    assert largest(turned - scene.R @ force) < 1e-4 * largest(force)
    equations = Equations(scene.problem.system)
    z, rng = equations.first(), np.random.default_rng((3, WORLD.rank))
    for i, body in enumerate(equations.system.bodies):
        part = equations.part(z, i)
        part += 1e-3 * rng.uniform(-1, 1, len(part))
        part[:] = body.with_conditions(part)
    norms = full_steps(equations, z, 3)
    assert norms[3] * norms[0] < norms[2] ** 2 + 1e-13 * norms[0] ** 2
