"""Random convex bodies with random meshes, in random poses: the scenes of ``run.py``."""

import dataclasses

import numpy as np
import scipy.spatial
from scenes import create_mesh, dealt

import basix.ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

#: Each formulation is drawn with the same probability.
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "quasi-symmetric")


@dataclasses.dataclass(frozen=True)
class Shape:
    """Vertices and cells of a body, the same on every rank."""

    x: np.ndarray
    cells: np.ndarray
    cell: str


@dataclasses.dataclass(frozen=True)
class Scene:
    """Two bodies, slave first, and the options of their contact."""

    index: int
    shapes: tuple[Shape, Shape]
    direction: np.ndarray  # from the slave to the master
    size: float
    whole: bool  # whether all of the boundary is a contact surface
    degree: int
    axisymmetric: bool
    tied: bool
    options: dict
    modulus: float

    @property
    def gdim(self):
        return len(self.direction)

    @property
    def words(self):
        """Description of the scene for output."""
        o = self.options
        cells = "/".join(shape.cell for shape in self.shapes)
        extra = [" axisymmetric"] * self.axisymmetric + [" tied"] * self.tied
        extra += [f" degree {self.degree}"] * (self.degree > 1)
        return f"{self.index}: {cells} {o['formulation']} {o['quadrature']}{''.join(extra)}"


def rotation(rng, gdim):
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(gdim, gdim)))
    q *= np.sign(np.diag(r))
    if np.linalg.det(q) < 0:
        q[:, 0] *= -1
    return q


def hull(rng, gdim):
    """Convex hull of random points on an ellipsoid and inside, meshed by Delaunay's method."""
    counts = (rng.integers(5, 12), rng.integers(1, 5)) if gdim == 2 else (rng.integers(7, 16), 3)
    surface = rng.normal(size=(counts[0], gdim))
    surface /= np.linalg.norm(surface, axis=1, keepdims=True)
    inside = 0.6 * rng.normal(size=(counts[1], gdim)) / np.sqrt(gdim)
    inside /= np.maximum(1.0, 1.5 * np.linalg.norm(inside, axis=1, keepdims=True))
    x = np.concatenate([surface, inside]) * rng.uniform(0.5, 1.0, gdim)
    cells = scipy.spatial.Delaunay(x).simplices
    corners = x[cells[:, 1:]] - x[cells[:, :1]]
    cells = cells[np.abs(np.linalg.det(corners)) > 1e-6]  # flat cells cannot be solved
    return Shape(x, cells, "triangle" if gdim == 2 else "tetrahedron")


def lattice(n):
    """Vertices of the unit cube's n[0] × n[1] (× n[2]) cells and their numbers."""
    points = np.stack(np.meshgrid(*[np.linspace(0, 1, k + 1) for k in n], indexing="ij"), axis=-1)
    number = np.arange(np.prod(np.add(n, 1))).reshape(np.add(n, 1))
    corners = []
    for offset in np.ndindex(*[2] * len(n)):
        corners.append(number[tuple(slice(o, o + k) for o, k in zip(offset, n, strict=True))])
    order = [0, 2, 1, 3] if len(n) == 2 else [0, 4, 2, 6, 1, 5, 3, 7]  # x runs fastest
    cells = np.stack(corners, axis=-1).reshape(-1, 2 ** len(n))[:, order]
    return points.reshape(-1, len(n)) - 0.5, cells


def block(rng, gdim, aligned):
    """A box of quadrilaterals or hexahedra; if not aligned, it is sheared and slightly warped."""
    n = rng.integers(1, 5 if gdim == 2 else 4, gdim)
    x, cells = lattice(n)
    if not aligned:
        x = x @ (np.eye(gdim) + rng.uniform(-0.25, 0.25, (gdim, gdim)))
        warp = rng.choice([0.0, 0.02, 0.1]) / n.max()
        x = x + warp * rng.uniform(-1, 1, x.shape)
    return Shape(x, cells, "quadrilateral" if gdim == 2 else "hexahedron")


def simplices(shape):
    """An aligned box whose cells are divided into triangles or tetrahedra."""
    cuts = [[0, 1, 3], [0, 2, 3]]
    if shape.x.shape[1] == 3:
        cuts = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]]
    cell = "triangle" if shape.x.shape[1] == 2 else "tetrahedron"
    return Shape(shape.x, shape.cells[:, cuts].reshape(-1, len(cuts[0])), cell)


def any_block(rng, gdim):
    shape = block(rng, gdim, True)
    return simplices(shape) if rng.random() < 0.5 else shape


def random_scene(seed, index):
    """Scene number `index` of this seed; the same on every rank."""
    rng = np.random.default_rng([seed, index])
    gdim = int(rng.choice([2, 3]))
    aligned = rng.random() < 0.3
    if aligned:  # faces on faces, with many coincident nodes
        shapes = [any_block(rng, gdim), any_block(rng, gdim)]
        direction = np.eye(gdim)[rng.integers(gdim)] * rng.choice([-1, 1])
    else:
        makes = [lambda: hull(rng, gdim), lambda: block(rng, gdim, False)]
        shapes = [makes[rng.integers(2)]() for _ in range(2)]
        shapes = [Shape(s.x @ rotation(rng, gdim).T, s.cells, s.cell) for s in shapes]
        direction = rotation(rng, gdim)[0]
    slave, master = shapes
    gap = rng.choice([0.0, 1e-14, -1e-14, 1e-10, 1e-6, -1e-3, 0.02, -0.05])
    reach = np.max(slave.x @ direction) - np.min(master.x @ direction) + gap
    across = rng.choice([0.0, 0.0, 1e-14, 1e-9, 0.25]) * rng.uniform(-1, 1, gdim)
    across -= (across @ direction) * direction
    size = 10.0 ** rng.choice([0, 0, -3, -6, 3])
    x = [slave.x * size, (master.x + reach * direction + across) * size]
    axisymmetric = gdim == 2 and rng.random() < 0.15
    if axisymmetric:
        left = min(points[:, 0].min() for points in x)
        x = [points - [left - 0.1 * size, 0] for points in x]
    quadrature = str(rng.choice(["nodal", "overlay"]))
    tied = bool(rng.random() < 0.25)
    options = {
        "formulation": str(rng.choice(FORMULATIONS)),
        "quadrature": quadrature,
        "normals": str(rng.choice(["facet", "bisector", "bisector"])),
        "penalty": 1.0 / size,
        "search_radius": rng.choice([0.05, 0.3, 1.0, 3.0]) * size
        if rng.random() < 0.5
        else "local",
    }
    return Scene(
        index=index,
        shapes=tuple(
            Shape(points, s.cells, s.cell) for points, s in zip(x, (slave, master), strict=True)
        ),
        direction=direction,
        size=size,
        whole=bool(rng.random() < 0.5),
        degree=2 if quadrature == "overlay" and rng.random() < 0.2 else 1,
        axisymmetric=axisymmetric,
        tied=tied,
        options=options,
        modulus=10.0 ** rng.choice([0, 0, 2, -3]),
    )


# --- Meshes and surfaces


def at_random(seed):
    """Partitioner that assigns cells to ranks at random, or all cells to one rank."""

    def ranks_of(total, size):
        rng = np.random.default_rng(seed)
        dest = rng.integers(size, size=total)
        return dest if rng.random() >= 0.3 else np.full(total, rng.integers(size))

    return dealt(ranks_of)


def make_mesh(comm, shape, seed):
    """Mesh of the body, with cells distributed at random."""
    domain = basix.ufl.element("Lagrange", shape.cell, 1, shape=(shape.x.shape[1],))
    mine = slice(None) if comm.rank == 0 else slice(0, 0)
    x = np.ascontiguousarray(shape.x[mine], dtype=np.float64)
    return create_mesh(shape.cells[mine], x, domain, comm, partitioner=at_random(seed))


def make_surface(msh, shape, toward, scene):
    """Contact surface: the boundary, or its part with normals along a direction."""
    fdim = msh.topology.dim - 1
    msh.topology.create_connectivity(fdim, fdim + 1)
    facets = mesh.exterior_facet_indices(msh.topology)
    if not scene.whole:
        low, high = np.min(shape.x @ toward), np.max(shape.x @ toward)
        middle = mesh.compute_midpoints(msh, fdim, facets)[:, : scene.gdim] @ toward
        facets = facets[middle > low + 0.2371 * (high - low)]
    V = fem.functionspace(msh, ("Lagrange", scene.degree, (scene.gdim,)))
    return qs.Surface(V, facets=facets, axisymmetric=scene.axisymmetric)


def make_surfaces(comm, scene):
    """Meshes and contact surfaces of both bodies on this communicator."""
    return [
        make_surface(
            make_mesh(comm, shape, [scene.index, i]), shape, (1 - 2 * i) * scene.direction, scene
        )
        for i, shape in enumerate(scene.shapes)
    ]


def make_contact(comm, scene):
    """The bodies' contact."""
    law = qs.Tied() if scene.tied else qs.Unilateral()
    return qs.Contact(*make_surfaces(comm, scene), law=law, **scene.options)
