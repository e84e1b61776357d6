"""Energies and forces of nested polygons and polyhedra, against those of another program."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.pair import overlay_rules


class Side:
    """Facets of one side, given by vertex positions; ``outward`` points to the outside."""

    def __init__(self, x, facets, outward):
        self.x, self.facets, self.outward = x, facets, outward

    def surface(self):
        gdim, corners = (2 if self.facets.shape[1] == 2 else 3), self.x[self.facets]
        dofs = self.facets[:, :, None] * gdim + np.arange(gdim)
        return _cpp.Surface(
            comm=MPI.COMM_SELF.py2f(),
            gdim=gdim,
            block=gdim,
            num_vertices=self.facets.shape[1],
            x=corners,
            degree=1,
            dofs=np.ascontiguousarray(dofs, dtype=np.int64),
            owner=np.zeros(self.facets.shape, dtype=np.int32),
            inside=corners.mean(axis=1) - self.outward(corners.mean(axis=1)),
            local_size=len(self.x) * gdim,
            axisymmetric=False,
        )


def size(x):
    """Return lengths of intervals or areas of triangles, (facets, vertices, 3)."""
    first = x[:, 1] - x[:, 0]
    if x.shape[1] == 2:
        return np.linalg.norm(first, axis=1)
    return np.linalg.norm(np.cross(first, x[:, 2] - x[:, 0]), axis=1) / 2


class Pass:
    """½ Σ_k G_k²/S_k of a slave and a master, with areas and S_k of the given positions."""

    def __init__(self, slave, master, both):
        self.sides, self.both = (slave, master), both
        self.gdim = 2 if slave.facets.shape[1] == 2 else 3
        self.still = [side.surface() for side in self.sides]
        self.moving = [side.surface() for side in self.sides]
        self.node_area = np.asarray(self.still[0].node_area)

    def evaluate(self, *places):
        """Set energy, forces (nodes, gdim), and both places, with vertices at the given places."""
        for surface, side, x in zip(self.moving, self.sides, places, strict=True):
            surface.follow(np.ascontiguousarray(x[side.facets]))
        self.pieces = _cpp.overlay_pieces(
            *self.moving, self.both, _cpp.KeptPairs(10.0), *overlay_rules(self.gdim, 4)
        )
        none, alone = np.zeros(0), np.zeros(0, dtype=np.int64)
        operator = _cpp.GapOperator(
            self.still[1], points_of=self.pieces, alone=alone, weight=none, far=1.0
        )
        self.sizes = [len(x) * self.gdim for x in places]
        vecs = [PETSc.Vec().createSeq(n) for n in self.sizes]
        weight = np.asarray(operator.row_area) * self.growth(places)
        at_nodes = vecs[0].duplicate()
        operator.add_to_nodes(-weight * np.asarray(operator.initial_gap), at_nodes.handle)
        gap = at_nodes.array.reshape(-1, self.gdim).sum(axis=1)  # of all sides of a node
        multiplier = gap / self.node_area
        self.energy = gap @ multiplier / 2
        at_nodes.array[:] = np.repeat(multiplier, self.gdim)
        force = weight * np.asarray(operator.at_points(at_nodes.handle))
        operator.add_transpose(force[:, None].copy(), *(v.handle for v in vecs))
        gaps = -self.growth(places) * np.asarray(operator.initial_gap)
        forces = np.concatenate([v.array for v in vecs]) + self.of_functions(gaps, at_nodes.array)
        self.forces = forces.reshape(-1, self.gdim)
        self.places = np.concatenate(places)[:, : self.gdim]
        return self

    def of_functions(self, rest, field):
        """Return the derivative of Σ_p w_p r_p Σ_k N_k λ_k by positions, as functions change."""
        first, num = sum(self.sizes), len(rest)
        matrix = PETSc.Mat().createAIJ(first + self.sizes[0], comm=PETSc.COMM_SELF)
        sums, none = _cpp.RowSums(matrix.handle), np.zeros(0)
        free = [PETSc.Vec().createSeq(n) for n in self.sizes]
        numbers = [_cpp.free_unknowns(self.pieces, i, v.handle) for i, v in enumerate(free)]
        numbers[1] += self.sizes[0]
        sides, rows = np.unique(self.pieces.side_dofs(), return_inverse=True)
        every = np.arange(len(sides) + 1, dtype=np.int64)
        _cpp.add_point_forces(
            sums,
            self.pieces,
            None,
            factors=[np.ones(1)] * 3,
            derivatives=[np.zeros((num, 1, 1)), np.zeros((num, 1))],
            values=[np.zeros(num), none, rest, none, none, none, none],
            fields=[0],
            missing=[],
            begun=[],
            moves=False,
            gaps_move=False,
            function_rows=rows.ravel().astype(np.int64),
            functions=[_cpp.CompressedRows(every, first + sides, np.ones(len(sides)))],
            own=False,
            numbers=numbers,
            scale=(1.0, 1.0),
            tool=-1,
            way=(0.0, 0.0, 0.0),
        )
        sums.insert()
        x, y = matrix.createVecs()
        x.array[first:] = field
        matrix.multTranspose(x, y)
        return y.array[:first].copy()

    def growth(self, places):
        """Return the given area of each segmented facet over its current area, (points,)."""
        facets, ends = np.asarray(self.pieces.facets()), self.sides[0].facets.shape[1] + 1
        out = np.empty(len(facets))
        for cut, side, x, columns in zip(
            (1, 0), self.sides, places, (slice(1, ends), slice(ends, None)), strict=True
        ):
            some = facets[:, 0] == cut
            nodes = facets[some, columns] // self.gdim
            out[some] = size(side.x[nodes]) / size(x[nodes])
        return out

    def balance(self):
        """Return the largest components of the net force and the net moment."""
        x, f = self.places, self.forces
        if self.gdim == 2:
            turn = np.sum(x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])
        else:
            turn = np.sum(np.cross(x, f), axis=0)
        return np.abs(f.sum(axis=0)).max(), np.abs(turn).max()


#: Translation of the bodies after the rotation.
SHIFT = np.array([0.01, -0.005, 0.0])


def polygon(radius, angle):
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def turned(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def shaft(both):
    """Make scene A: a polygon with 11 sides in one with 17."""
    i, j = np.arange(11), np.arange(17)
    x = polygon(1.0, 2 * np.pi * (i + 0.2 * np.sin(1.7 * i)) / 11)
    z = polygon(1.01, 2 * np.pi * (j + 0.25 * np.cos(2.3 * j)) / 17)
    slave = Side(x, np.stack([i, (i + 1) % 11], axis=1), lambda c: 0.1 * c)
    master = Side(z, np.stack([(j + 1) % 17, j], axis=1), lambda c: -0.1 * c)
    return Pass(slave, master, both)


def polyhedra(both):
    """Make scene D: an icosahedron, refined once, in another one."""
    x, facets = icosahedron()
    z = 1.03 * x @ spun([0.3, 0.2, 0.5]).T
    slave = Side(x, facets, lambda c: 0.1 * c)
    master = Side(z, facets[:, ::-1].copy(), lambda c: -0.1 * c)
    return Pass(slave, master, both)


def spun(vector):
    """Return the matrix of a rotation vector."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    a = vector / angle
    cross = np.cross(np.eye(3), a)
    return np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(a, a)


def icosahedron():
    """Return a unit icosahedron: each facet divided into four, all vertices on the unit sphere."""
    golden = (1 + 5**0.5) / 2
    x = [
        v
        for a in (-1.0, 1.0)
        for b in (-golden, golden)
        for v in ((a, b, 0.0), (0.0, a, b), (b, 0.0, a))
    ]
    x = [np.array(v) / np.linalg.norm(v) for v in x]
    near = [
        [j for j in range(12) if j != i and np.linalg.norm(x[i] - x[j]) < 1.2] for i in range(12)
    ]
    corners = [
        (i, j, k) for i in range(12) for j in near[i] for k in near[j] if i < j < k and k in near[i]
    ]
    middles, facets = {}, []

    def middle(a, b):
        key = min(a, b), max(a, b)
        if key not in middles:
            mean = x[a] + x[b]
            middles[key] = len(x)
            x.append(mean / np.linalg.norm(mean))
        return middles[key]

    for a, b, c in corners:
        if np.dot(np.cross(x[b] - x[a], x[c] - x[a]), x[a]) < 0:
            b, c = c, b
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        facets += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.array(x), np.array(facets)


def near(value, expected, digits):
    return np.all(np.abs(np.asarray(value) / np.asarray(expected) - 1) < 10.0**-digits)


SHAFT = {
    True: (
        2.483848408851e-3,
        6.743432602e-2,
        (-1.5179894070e-2, -1.9792135104e-3),
    ),
    False: (
        2.382747867461e-3,
        6.545743899e-2,
        (-1.4863658387e-2, -1.7761668267e-3),
    ),
}


@pytest.mark.parametrize("both", (True, False))
def test_shaft_in_a_hole(both):
    scene = shaft(both)
    x = turned(scene.sides[0].x, 0.1) + SHIFT
    scene.evaluate(x, scene.sides[1].x)
    energy, force, first = SHAFT[both]
    assert near(scene.energy, energy, 12)
    assert near(np.linalg.norm(scene.forces), force, 9)
    assert near(scene.forces[0], first, 9)
    assert max(scene.balance()) < 1e-14


@pytest.mark.parametrize(
    ("both", "energy", "force"),
    [(False, 1.7903288287e-4, 1.4758184434e-2), (True, 1.7901946183e-4, 1.4757387654e-2)],
)
def test_flat_with_open_ends(both, energy, force):
    x, z = np.array([0, 0.1, 0.35, 0.5, 0.9, 1.2]), np.array([-0.3, 0.17, 0.45, 0.8, 1.5])
    up = np.array([0.0, 0.1, 0.0])
    slave, master = (
        Side(
            np.stack([a, height, 0 * a], axis=1),
            np.stack([np.arange(len(a) - 1), np.arange(1, len(a))], axis=1),
            lambda c, outward=outward: outward + 0 * c,
        )
        for a, height, outward in (
            (x, -0.01 - 0.02 * x + 0.01 * x * x, up),
            (z, 0 * z, -up),
        )
    )
    scene = Pass(slave, master, both)
    scene.evaluate(slave.x, master.x)
    assert near(scene.energy, energy, 10)
    assert near(np.linalg.norm(scene.forces), force, 10)
    assert max(scene.balance()) < 1e-16


@pytest.mark.parametrize(
    ("both", "energy", "force"),
    [(True, 5.6197185836e-3, 7.9200356167e-2), (False, 5.0293804004e-3, 7.2367066813e-2)],
)
def test_polyhedra(both, energy, force):
    scene = polyhedra(both)
    x = scene.sides[0].x @ spun([0.03, -0.05, 0.08]).T + [0.01, -0.005, 0.004]
    scene.evaluate(x, scene.sides[1].x)
    assert near(scene.energy, energy, 10)
    assert near(np.linalg.norm(scene.forces), force, 10)
    assert max(scene.balance()) < 1e-14


def test_sides_may_be_mirrored():
    """Reversing the numbering of facets does not change the facets."""
    scene, other = shaft(True), shaft(True)
    for side in other.sides:
        side.facets = side.facets[:, ::-1].copy()
    other = Pass(*other.sides, True)
    x = turned(scene.sides[0].x, 0.1) + SHIFT
    places = x, scene.sides[1].x
    scene.evaluate(*places)
    other.evaluate(*places)
    assert np.abs(scene.forces - other.forces).max() < 1e-15


@pytest.mark.parametrize("both", (True, False))
def test_forces_do_not_jump(both):
    """Forces are continuous as a polygon rotates in another and vertices pass each other."""
    scene, tiny = shaft(both), 1e-14
    x, z = (side.x for side in scene.sides)
    angles = [np.arctan2(a[:, 1], a[:, 0]) for a in (x, z)]
    passing = np.mod(np.subtract.outer(angles[1], angles[0]).ravel() + np.pi, 2 * np.pi) - np.pi
    for angle in passing[::5]:
        before, there, after = (
            scene.evaluate(turned(x, angle + side * tiny), z).forces for side in (-1, 0, 1)
        )
        largest = np.abs(there).max()
        assert np.abs(before - there).max() < 1e-12 * largest
        assert np.abs(after - there).max() < 1e-12 * largest


@pytest.mark.parametrize("both", (True, False))
def test_forces_of_polyhedra_do_not_jump(both):
    """Forces are continuous as vertices pass edges and vertices of a fitting polyhedron."""
    scene, tiny = polyhedra(both), 1e-14
    x, _ = icosahedron()
    fits = x @ spun([0.3, 0.2, 0.5]).T  # vertices lie on rays through those of the other
    axis = np.array([0.2, 0.5, -0.3])
    forces = [
        scene.evaluate(fits @ spun(side * tiny * axis).T if side else fits, 1.03 * fits).forces
        for side in (-1, 0, 1)
    ]
    largest = np.abs(forces[1]).max()
    assert np.abs(forces[0] - forces[1]).max() < 1e-12 * largest
    assert np.abs(forces[2] - forces[1]).max() < 1e-12 * largest


@pytest.mark.parametrize("both", (True, False))
@pytest.mark.parametrize("make", (shaft, polyhedra))
def test_forces_are_the_gradient(make, both):
    """On closed surfaces that cover each other forces are the gradient, clipping included."""
    scene = make(both)
    rng = np.random.default_rng(5)
    x, z = (side.x for side in scene.sides)
    moves = [rng.normal(size=a.shape) for a in (x, z)]
    if scene.gdim == 2:
        for move in moves:
            move[:, 2] = 0
    x = x + 0.004 * moves[0]
    step = 1e-6
    ends = [
        scene.evaluate(x + s * step * moves[0], z + s * step * moves[1]).energy for s in (1, -1)
    ]
    forces = scene.evaluate(x, z).forces
    power = np.sum(forces * np.concatenate(moves)[:, : scene.gdim])
    assert abs((ends[0] - ends[1]) / (2 * step) - power) < 1e-7 * abs(power)


@pytest.mark.parametrize("both", (True, False))
@pytest.mark.parametrize("make", (shaft, polyhedra))
def test_turning_everything(make, both):
    """Rotating the whole scene keeps the energy and rotates the forces."""
    scene = make(both)
    turn = spun([0, 0, 1.3]) if scene.gdim == 2 else spun([0.7, -1.1, 0.4])
    shift = np.array([3.0, -2.0, 0.0 if scene.gdim == 2 else 1.0])
    x, z = (side.x for side in scene.sides)
    x = x + SHIFT
    before = scene.evaluate(x, z)
    energy, forces = before.energy, before.forces
    scene.evaluate(x @ turn.T + shift, z @ turn.T + shift)
    expected = forces @ turn[: scene.gdim, : scene.gdim].T
    assert abs(scene.energy / energy - 1) < 1e-12
    assert np.abs(scene.forces - expected).max() < 1e-13 * np.abs(forces).max() + 1e-16
