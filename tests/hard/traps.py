"""Case 3: projections that have two answers, or hardly one.

A tetrahedron (2D: triangle) whose tip points down is above a surface with an edge, a corner, a
groove, a pit, an end, or two faces. How far away the surface is from the tip is known.
"""

import itertools
import math

import numpy as np
from fuzz.bodies import Shape, lattice, make_mesh
from hard.scenes import COMM, Check

from dolfinx import fem, mesh

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp

#: Height of the tip above the place that is meant.
D = 0.05

#: Height of the surface over a horizontal place (x, y), and distance of a tip above the origin.
SURFACES = {
    "edge": (lambda x, y: -np.abs(x), D),
    "corner": (lambda x, y: -np.abs(x) - np.abs(y), D),
    "groove": (lambda x, y: np.abs(x), D / math.sqrt(2)),
    "pit": (lambda x, y: np.abs(x) + np.abs(y), D / math.sqrt(3)),
    "saddle": (lambda x, y: np.abs(x) - np.abs(y), None),
}


def surface_of(msh, facets):
    V = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
    return qs.Surface(V, facets=facets)


def tip(gdim, place):
    """Surface of a small simplex whose lowest vertex is at a place."""
    spread = 0.01
    corners = {
        2: [[0, 0], [-1, 2], [1, 2]],
        3: [[0, 0, 0], [1, 0, 2], [-0.5, 0.75**0.5, 2], [-0.5, -(0.75**0.5), 2]],
    }[gdim]
    x = spread * np.array(corners, dtype=float) + place
    cell = "triangle" if gdim == 2 else "tetrahedron"
    msh = make_mesh(COMM, Shape(x, np.arange(gdim + 1)[None], cell), 0)
    top = place[-1] + 1.9 * spread
    low = mesh.locate_entities_boundary(msh, gdim - 1, lambda p: p[gdim - 1] > top)
    fdim = gdim - 1
    msh.topology.create_connectivity(fdim, gdim)
    every = mesh.exterior_facet_indices(msh.topology)
    return surface_of(msh, np.setdiff1d(every, low))


def block_under(gdim, height, n=4, seed=None, simplex=False):
    """Block over [-1, 1]^(gdim-1) whose upper side has a given height, from -3 on.

    Args:
        gdim: Dimension.
        height: Function of x and y.
        n: Cells along each edge, even.
        seed: Of a random order of vertices and cells.
        simplex: Whether it is of triangles or tetrahedra.
    """
    x, cells = lattice([n] * (gdim - 1) + [1])
    x = 2 * x
    upper = x[:, -1] > 0
    flat = np.zeros((len(x), 2))
    flat[:, : gdim - 1] = x[:, :-1]
    x[:, -1] = np.where(upper, height(flat[:, 0], flat[:, 1]), -3.0)
    shape = Shape(x, cells, "quadrilateral" if gdim == 2 else "hexahedron")
    if simplex:
        from fuzz.bodies import simplices

        shape = simplices(shape)
    if seed is not None:
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(x))
        number = np.argsort(order)
        shape = Shape(x[order], number[shape.cells][rng.permutation(len(shape.cells))], shape.cell)
    msh = make_mesh(COMM, shape, seed or 0)
    fdim = gdim - 1
    low = -2.99

    def on_top(p):
        flat = np.zeros((2, p.shape[1]))
        flat[: gdim - 1] = p[: gdim - 1]
        return (np.abs(p[gdim - 1] - height(*flat)) < 1e-9) & (p[gdim - 1] > low)

    return surface_of(msh, mesh.locate_entities_boundary(msh, fdim, on_top))


def place_found(nodes, surface, place, radius=1.0):
    """Where the node at a place is projected to, or None. Collective."""
    found, point = _cpp.closest_facets(nodes._cpp_object, surface._cpp_object, radius)
    target = np.zeros(3)
    target[: len(place)] = place
    here = [
        p.tolist()
        for x, f, p in zip(nodes.node_x, found, point, strict=True)
        if f and np.linalg.norm(x - target) < 1e-9
    ]
    every = [p for part in COMM.allgather(here) for p in part]
    return np.array(every[0]) if every else None


def over(gdim, name, simplex):
    """Error of the distance over a feature, in any order of cells and vertices; the same facet."""
    height, distance = SURFACES[name]
    place = np.zeros(gdim)
    place[-1] = D
    found = []
    for seed in (None, 1, 2, 3, 4):
        surface = block_under(gdim, height, seed=seed, simplex=simplex)
        found.append(place_found(tip(gdim, place), surface, place))
        assert found[-1] is not None, f"not paired over the {name}"
    target = np.zeros(3)
    target[:gdim] = place
    far = [np.linalg.norm(x - target) for x in found]
    if distance is None:  # a minimum over the flanks
        distance = min(far)
    error = max(abs(d / distance - 1) for d in far)
    return max(error, *(np.linalg.norm(x - found[0]) for x in found)), 0


def beyond(gdim, off):
    """Whether a tip beyond the end of a flat surface is paired: it is as long as it is near."""
    place = np.zeros(gdim)
    place[0], place[-1] = 1.0 + off, D
    x = place_found(tip(gdim, place), block_under(gdim, lambda x, y: 0 * x), place)
    if off > 0.2:
        return float(x is not None), 0
    target = np.zeros(3)
    target[:gdim] = place
    return abs(np.linalg.norm(x - target) / math.hypot(D, max(off, 0.0)) - 1), 0


def thin_plate(gdim, thickness):
    """Tips above and below a plate that is far thinner than the radius: each gets its own side."""
    worst = 0.0
    for side in (1.0, -1.0):
        x, cells = lattice([4] * (gdim - 1) + [1])
        x[:, -1] = np.where(x[:, -1] > 0, 0.0, -thickness)
        cell = "quadrilateral" if gdim == 2 else "hexahedron"
        if side < 0:  # turned upside down
            x[:, -1] = -thickness - x[:, -1]
            cells = cells[:, np.arange(cells.shape[1]) ^ (1 << (gdim - 1))]
        msh = make_mesh(COMM, Shape(x, cells, cell), 0)
        msh.topology.create_connectivity(gdim - 1, gdim)
        surface = surface_of(msh, mesh.exterior_facet_indices(msh.topology))
        # Above the plate, in it and, by rounding, on either face.
        for height in (D, 1e-14, 0.0, -1e-14, -0.3 * thickness, -0.9 * thickness, -thickness):
            place = np.full(gdim, 0.03)
            place[-1] = height
            found = place_found(tip(gdim, place), surface, place)
            assert found is not None, f"not paired at {height}"
            worst = max(worst, abs(found[gdim - 1]))
    return worst, 0


#: Vertex orders of a quadrilateral: the square's symmetries.
ORDERS = (
    (0, 1, 2, 3),
    (1, 3, 0, 2),
    (3, 2, 1, 0),
    (2, 0, 3, 1),
    (1, 0, 3, 2),
    (2, 3, 0, 1),
    (0, 2, 1, 3),
    (3, 1, 2, 0),
)


def warped(height, h):
    """Non-planar quadrilateral z = h xy, and a point over its middle that has two projections.

    Both are equally far: the answer is one of them, the same in any order of the vertices.
    """
    v = np.array([[x, y, h * x * y] for y, x in itertools.product((-1, 1), (-1, 1))], dtype=float)
    s = np.linspace(-1, 1, 2001)  # both lie on the diagonal where the patch comes nearer
    curve = np.stack([s, s * np.sign(h * height), h * np.sign(h * height) * s * s], axis=1)
    expected = np.linalg.norm(curve - [0, 0, height], axis=1).min()
    found = []
    for order in ORDERS:
        distance, _, x = _cpp.closest_point(4, v[list(order)], np.array([0.0, 0.0, height]))
        found.append(x)
        assert distance < expected + 1e-12, "a nearer point was missed"
        assert distance > expected - 1e-5
    return max(np.linalg.norm(np.subtract(x, found[0])) for x in found), 0


def checks(kind):
    """Projections do not depend on the kind: for the first nodal one alone."""
    if tuple(kind) != ("quasi-symmetric", "nodal", "penalty"):
        return
    for gdim, name in ((2, "edge"), (2, "groove"), *((3, name) for name in SURFACES)):
        for simplex in (False, True):
            cells = ("triangles" if gdim == 2 else "tetrahedra") if simplex else "boxes"
            yield Check(
                "3 projection",
                f"over {'an' if name == 'edge' else 'a'} {name}, {gdim}D, {cells}",
                "distance and place",
                1e-12,
                lambda a=(gdim, name, simplex): over(*a),
            )
    for off in (-1e-12, 0.0, 1e-14, 1e-12, 1e-9, 0.3):
        for gdim in (2, 3):
            label = f"{off:.0e} beyond the end, {gdim}D"
            what = "not paired" if off > 0.2 else "distance"
            run = lambda a=(gdim, off): beyond(*a)  # noqa: E731
            yield Check("3 projection", label, what, 1e-9 if off < 0.2 else 0.0, run)
    for gdim in (2, 3):
        for thickness in (0.03, 1e-3, 1e-6):
            label = f"plate {thickness:.0e} thick, {gdim}D"
            run = lambda a=(gdim, thickness): thin_plate(*a)  # noqa: E731
            yield Check("3 projection", label, "its own side", 1e-15, run)
    for height, h in ((3.0, 1.0), (1.5, -1.0), (0.9, 2.0), (-2.0, 0.8)):
        label = f"z = {h} xy from {height}"
        run = lambda a=(height, h): warped(*a)  # noqa: E731
        yield Check("3 projection", label, "the same place in any order", 1e-9, run)
