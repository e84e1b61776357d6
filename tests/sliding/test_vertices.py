"""Vertices at creases, of contact that follows the bodies: they bear from the first touch on."""

import numpy as np
import pytest
from following import Body, moment, problem_of, rotation, total
from scenes import WORLD, box, largest, plane
from system.test_equations import away, errors

import qsdolfinx as qs
from qsdolfinx.gap.facet_cutter import Vertices
from qsdolfinx.system.equations import Equations

FINITE = {"sliding": "finite", "constraints": "points"}
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


class OnCorner:
    """A box that stands on a corner on another one, the slave being either.

    Args:
        cell: Of both.
        depth: By which the corner is in the other box at first.
        swapped: Whether the lower one is the slave.
        turn: Matrix by which all is turned.
    """

    def __init__(self, cell, depth=0.0, swapped=False, turn=None, **contact):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        n = ((3,) * gdim, (4,) * gdim)
        low = np.array([-0.55, *((-0.47,) * (gdim - 2)), -1.0]), np.zeros(gdim)
        meshes = [box(WORLD, k, cell, a, a + 1, "scattered") for k, a in zip(n, low, strict=True)]
        faces = [[plane(meshes[0], gdim - 1, 0.0)], [plane(meshes[1], i, 0.0) for i in range(gdim)]]
        far = [[plane(meshes[0], gdim - 1, -1.0)], [plane(meshes[1], i, 1.0) for i in range(gdim)]]
        tilt = rotation(0.7)
        if gdim == 3:
            diagonal = np.ones(3) / np.sqrt(3)
            across = np.cross(diagonal, [0.0, 0.0, 1.0])
            tilt = rotation(np.arcsin(np.linalg.norm(across)), across) @ rotation(0.3, diagonal)
            tilt = rotation(0.12, [1.0, 0.2, 0.0]) @ tilt
        x = meshes[1].geometry.x
        x[:, :gdim] = x[:, :gdim] @ tilt.T
        x[:, gdim - 1] -= depth
        self.turn = np.eye(gdim) if turn is None else turn
        for msh in meshes:
            msh.geometry.x[:, :gdim] = msh.geometry.x[:, :gdim] @ self.turn.T
        self.bodies = [Body(msh) for msh in meshes]
        self.held = [b.clamp(np.concatenate(f)) for b, f in zip(self.bodies, far, strict=True)]
        surfaces = [b.surface(np.concatenate(f)) for b, f in zip(self.bodies, faces, strict=True)]
        first, second = surfaces if swapped else surfaces[::-1]
        self.upper = "master" if swapped else "slave"
        self.contact = qs.Contact(first, second, **(FINITE | contact))
        self.problem = problem_of(self.bodies, [self.contact])

    def move(self, *way):
        """Displacement of the upper box' far sides."""
        self.held[1].value[:] = self.turn @ np.array(way)


@pytest.mark.parametrize("swapped", (False, True))
@pytest.mark.parametrize("cell", CELLS)
def test_derivative(cell, swapped, monkeypatch):
    """Of forces and of the corners' rows by everything, the corner being closed; areas held.

    So is how facets opposite are curved between the normals at their nodes.
    """
    held, found = {}, Vertices._raise

    def raised(self, pieces, master):
        found(self, pieces, master)
        bent = pieces.rise + 0.02 * (pieces.rise != 0) * np.sin(np.arange(len(pieces.rise)))
        pieces.rise = held.setdefault(self, bent)

    scene = OnCorner(cell, 0.02, swapped)
    monkeypatch.setattr(Vertices, "_raise", raised)
    scene.problem.set_up()
    equations = Equations(scene.problem.system)
    z, scale = away(equations, size=0.002)
    for i, body in enumerate(equations.system.bodies):
        equations.part(z, i)[body.owned_constrained] = 0.0
    sides, *vertices = equations.multipliers(z)
    sides.normal[:] = -1e6  # open
    for values in vertices:
        values.normal[:] += 5.0
    at = equations.evaluate(z)
    closed = [WORLD.allreduce(np.count_nonzero(p.normal.active)) for p in at.passes]
    assert closed[0] == 0 and sum(closed) == 1
    passes = range(len(scene.bodies) + 1, len(scene.bodies) + len(equations.passes))

    def of_vertices(values):
        rows = [equations.layout.part(values, i) for i in passes]
        return np.concatenate([equations.bodies_of(values), *rows])

    assert errors(equations, z, scale, of=of_vertices) < 1e-6


@pytest.mark.parametrize("swapped", (False, True))
@pytest.mark.parametrize("cell", CELLS)
def test_from_the_first_touch(cell, swapped):
    """Forces grow with the depth; they balance, and nothing is deep."""
    forces, size = [], 0.25
    for part in (0.02, 0.1):
        scene = OnCorner(cell, 0.0, swapped)
        scene.move(*(0.0,) * (scene.gdim - 1), -part * size)
        scene.problem.solve()
        forces.append(scene.contact.force(scene.upper)[-1])
        assert scene.contact.penetration() < 0.03 * part * size  # facets are taken as curved
        assert largest(scene.contact.force("slave") + scene.contact.force("master")) < 1e-12
    assert forces[0] > 0 and abs(forces[1] / forces[0] / 5 - 1) < 0.1


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_turned(cell):
    """Turning everything turns forces, with friction too; forces and moments of all are none."""
    forces = []
    for angle in (0.0, 0.9):
        axis = () if cell == "triangle" else ([0.3, 0.5, 0.2],)
        scene = OnCorner(cell, turn=rotation(angle, *axis), friction=qs.Coulomb(0.2))
        for way in ((0.0, -0.02), (0.03, -0.03)):
            scene.move(way[0], *(0.0,) * (scene.gdim - 2), way[1])
            scene.problem.solve()
        forces.append(scene.turn.T @ scene.contact.force("slave"))
        inside = [body.internal_forces() for body in scene.bodies]
        found = [moment(body.places, f) for body, f in zip(scene.bodies, inside, strict=True)]
        size = largest(*inside)
        assert largest(sum(total(f) for f in inside)) < 1e-10 * size
        assert largest(sum(found)) < 1e-8 * size
    np.testing.assert_allclose(*forces, rtol=1e-8, atol=1e-8 * largest(forces[0]))


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("shape", ("plane", "facets"))
def test_on_a_tool(cell, shape):
    """A box on its corner on a flat tool of a known shape or of facets: as in small sliding."""
    forces = []
    for sliding in ("small", "finite"):
        scene = OnCorner(cell)
        gdim, body = scene.gdim, scene.bodies[1]
        up, start = np.eye(gdim)[-1], np.zeros(gdim)
        tool = qs.RigidSurface.plane(WORLD, start, up)
        if shape == "facets":
            x, facets = np.array([[1.0, 0.0], [0.1, 0.0], [-1.0, 0.0]]), [[0, 1], [1, 2]]
            if gdim == 3:
                x = np.array([[-1.1, -1, 0], [1, -1.2, 0], [1, 1, 0], [-1, 1.1, 0]])
                facets = [[0, 1, 2], [0, 2, 3]]
            tool = qs.RigidSurface.triangulated(WORLD, x, facets)
        faces = scene.contact.slave
        contact = qs.Contact(faces, tool, **(FINITE | {"sliding": sliding}))
        problem = problem_of([body], [contact])
        scene.move(*(0.0,) * (gdim - 1), -0.02)
        problem.solve()
        forces.append(contact.force("slave"))
        assert contact.penetration() < 1e-10
    assert forces[0][-1] > 0
    np.testing.assert_allclose(*forces, rtol=1e-7, atol=1e-7 * largest(forces[0]))


def test_onto_a_corner():
    """A half disc comes from beside a block, meets its corner, and climbs onto it."""
    block = Body(box(WORLD, (15, 5), "quadrilateral", (0.0, -1.0), (3.0, 0.0), "scattered"))
    msh = box(WORLD, (24, 3), "quadrilateral", (0.0, 0.0), (1.0, 1.0), "scattered")
    rim, hub = plane(msh, 1, 1.0), plane(msh, 1, 0.0)
    x = msh.geometry.x
    angle, radius = np.pi * (1 + x[:, 0]), 0.25 + 0.25 * x[:, 1]
    x[:, 0], x[:, 1] = -0.75 + radius * np.cos(angle), 0.45 + radius * np.sin(angle)
    disc = Body(msh)
    block.clamp(plane(block.mesh, 1, -1.0))
    drawn = disc.clamp(hub)
    faces = np.concatenate([plane(block.mesh, 1, 0.0), plane(block.mesh, 0, 0.0)])
    friction = qs.Coulomb(0.2)
    contact = qs.Contact(disc.surface(rim), block.surface(faces), friction=friction, **FINITE)

    def drive(t, dt):
        drawn.value[0] = t

    stepper = qs.TimeStepper(problem_of([block, disc], [contact]), 0.1, drive, dt_max=0.1)
    forces = []
    for _ in stepper.run(2.5):
        forces.append(contact.force("slave"))
        assert contact.penetration() < 0.01
    assert max(step.iterations for step in stepper.log) <= 25
    ratios = [-force[0] / (0.2 * force[1]) for force in forces if force[1] > 1e-3]
    assert max(ratios) > 2.0  # the corner holds it up
    assert 0.8 < ratios[-1] < 1.0 + 1e-6  # all slips along the top
