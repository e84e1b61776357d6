"""Case 3: projections that have two solutions, or are barely defined.

A tetrahedron (2D: triangle) with its tip down is above a surface with an edge, a corner, a groove,
a pit, an end, or two faces. The distance of the surface from the tip is known.
"""

import itertools
import math

import numpy as np
from fuzz.bodies import Shape, lattice, make_mesh, simplices
from hard.cases import Case, Variant
from scenes import WORLD, vector_space

from dolfinx import mesh

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp

#: Height of the tip above the intended point.
D = 0.05

#: Height of the surface at a horizontal position (x, y), and distance of a tip above the origin.
SURFACES = {
    "edge": (lambda x, y: -np.abs(x), D),
    "corner": (lambda x, y: -np.abs(x) - np.abs(y), D),
    "groove": (lambda x, y: np.abs(x), D / math.sqrt(2)),
    "pit": (lambda x, y: np.abs(x) + np.abs(y), D / math.sqrt(3)),
    "saddle": (lambda x, y: np.abs(x) - np.abs(y), None),
}


def surface_of(msh, facets=None):
    """Make a contact surface of these facets, or of the whole boundary."""
    if facets is None:
        msh.topology.create_connectivity(msh.topology.dim - 1, msh.topology.dim)
        facets = mesh.exterior_facet_indices(msh.topology)
    return qs.Surface(vector_space(msh), facets=facets)


def box(gdim, n=4):
    """Return vertices of a block over [-1/2, 1/2], one cell high, its cells, and their shape."""
    x, cells = lattice([n] * (gdim - 1) + [1])
    return x, cells, "quadrilateral" if gdim == 2 else "hexahedron"


def tip(gdim, place):
    """Make the surface of a small simplex whose lowest vertex is at a given point."""
    spread = 0.01
    corners = {
        2: [[0, 0], [-1, 2], [1, 2]],
        3: [[0, 0, 0], [1, 0, 2], [-0.5, 0.75**0.5, 2], [-0.5, -(0.75**0.5), 2]],
    }[gdim]
    x = spread * np.array(corners, dtype=float) + place
    cell = "triangle" if gdim == 2 else "tetrahedron"
    msh = make_mesh(WORLD, Shape(x, np.arange(gdim + 1)[None], cell), 0)
    sides = mesh.locate_entities_boundary(msh, gdim - 1, lambda p: 0 * p[0] == 0)
    high = mesh.locate_entities_boundary(
        msh, gdim - 1, lambda p: p[gdim - 1] > place[-1] + 1.9 * spread
    )
    return surface_of(msh, np.setdiff1d(sides, high))


def block_under(gdim, height, n=4, seed=None, simplex=False):
    """Make a block over [-1, 1]^(gdim-1) from -3 up to an upper side of a given height.

    Args:
        gdim: Dimension of space.
        height: Function of x and y.
        n: Number of cells along each edge, even.
        seed: Seed of a random order of vertices and cells.
        simplex: Whether the cells are triangles or tetrahedra.
    """
    x, cells, cell = box(gdim, n)
    x, upper = 2 * x, x[:, -1] > 0
    flat = np.zeros((len(x), 2))
    flat[:, : gdim - 1] = x[:, :-1]
    x[:, -1] = np.where(upper, height(*flat.T), -3.0)
    shape = Shape(x, cells, cell)
    if simplex:
        shape = simplices(shape)
    if seed is not None:
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(x))
        number = np.argsort(order)
        shape = Shape(x[order], number[shape.cells][rng.permutation(len(shape.cells))], shape.cell)
    msh = make_mesh(WORLD, shape, seed or 0)

    def on_top(p):
        flat = np.zeros((2, p.shape[1]))
        flat[: gdim - 1] = p[: gdim - 1]
        return (np.abs(p[gdim - 1] - height(*flat)) < 1e-9) & (p[gdim - 1] > -2.99)

    return surface_of(msh, mesh.locate_entities_boundary(msh, gdim - 1, on_top))


def onto(surface, place):
    """Return the projection of a tip, or None, and its distance. Collective."""
    contact = qs.Contact(
        tip(len(place), place),
        surface,
        formulation="master-slave",
        quadrature="nodal",
        penalty=1.0,
        search_radius=1.0,
        initial_overclosure="ignore",  # points may be inside
    )
    target, p = np.pad(place, (0, 3 - len(place))), contact.pairing
    here = p.master.x[np.linalg.norm(p.slave.x - target, axis=1) < 1e-9]
    every = np.concatenate(WORLD.allgather(here))
    return (every[0], np.linalg.norm(every[0] - target)) if len(every) else (None, math.inf)


def over(gdim, name, simplex):
    """Return the error of distance and place over a feature, for orders of cells and vertices."""
    height, distance = SURFACES[name]
    place = np.eye(gdim)[-1] * D
    orders = (None, 1, 2, 3, 4)
    surfaces = [block_under(gdim, height, seed=seed, simplex=simplex) for seed in orders]
    found, far = zip(*(onto(surface, place) for surface in surfaces), strict=True)
    assert math.inf not in far, f"not paired over the {name}"
    if distance is None:  # a minimum over the flanks
        distance = min(far)
    error = max(abs(d / distance - 1) for d in far)
    return max(error, *(np.linalg.norm(x - found[0]) for x in found))


def beyond(gdim, off):
    """A tip beyond the end of a flat surface must be paired only if it is near."""
    place = np.eye(gdim)[-1] * D
    place[0] += 1.0 + off
    x, far = onto(block_under(gdim, lambda x, y: 0 * x), place)
    if off > 0.2:
        return float(x is not None)
    return abs(far / math.hypot(D, max(off, 0.0)) - 1)


def thin_plate(gdim, thickness):
    """Tips above and below a plate that is far thinner than the radius must find their own side."""
    worst = 0.0
    for side in (1.0, -1.0):
        x, cells, cell = box(gdim)
        x[:, -1] = np.where(x[:, -1] > 0, 0.0, -thickness)
        if side < 0:  # upside down
            x[:, -1] = -thickness - x[:, -1]
            cells = cells[:, np.arange(cells.shape[1]) ^ (1 << (gdim - 1))]
        surface = surface_of(make_mesh(WORLD, Shape(x, cells, cell), 0))
        # Above the plate, inside it and, up to rounding, on either face.
        for height in (D, 1e-14, 0.0, -1e-14, -0.3 * thickness, -0.9 * thickness, -thickness):
            place = np.full(gdim, 0.03)
            place[-1] = height
            found, _ = onto(surface, place)
            assert found is not None, f"not paired at {height}"
            worst = max(worst, abs(found[gdim - 1]))
    return worst


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
    """A point over the middle of a non-planar quadrilateral z = h xy has two projections.

    Both have the same distance: the result is one of them, for any order of the vertices.
    """
    v = np.array([[x, y, h * x * y] for y, x in itertools.product((-1, 1), (-1, 1))], dtype=float)
    s = np.linspace(-1, 1, 2001)  # both lie on the diagonal that is closer to the point
    curve = np.stack([s, s * np.sign(h * height), h * np.sign(h * height) * s * s], axis=1)
    expected = np.linalg.norm(curve - [0, 0, height], axis=1).min()
    found = []
    for order in ORDERS:
        distance, _, x = _cpp.closest_point(4, v[list(order)], np.array([0.0, 0.0, height]))
        found.append(x)
        assert distance < expected + 1e-12, "a nearer point was missed"
        assert distance > expected - 1e-5
    return max(np.linalg.norm(np.subtract(x, found[0])) for x in found)


def cases(variant):
    """Projections do not depend on the variant: run them for one variant."""
    if variant != Variant(quadrature="nodal"):
        return

    def case(label, what, allowed, run, *given):
        return Case("3 projection", label, what, allowed, lambda: run(*given), short=True)

    for gdim, name in ((2, "edge"), (2, "groove"), *((3, name) for name in SURFACES)):
        for cells in ("boxes", "triangles" if gdim == 2 else "tetrahedra"):
            label = f"over {'an' if name == 'edge' else 'a'} {name}, {gdim}D, {cells}"
            yield case(label, "distance and place", 1e-12, over, gdim, name, cells != "boxes")
    for off in (-1e-12, 0.0, 1e-14, 1e-12, 1e-9, 0.3):
        for gdim in (2, 3):
            what, allowed = ("distance", 1e-9) if off < 0.2 else ("not paired", 0.0)
            yield case(f"{off:.0e} beyond the end, {gdim}D", what, allowed, beyond, gdim, off)
    for gdim in (2, 3):
        for thickness in (0.03, 1e-3, 1e-6):
            label = f"plate {thickness:.0e} thick, {gdim}D"
            yield case(label, "its own side", 1e-15, thin_plate, gdim, thickness)
    for height, h in ((3.0, 1.0), (1.5, -1.0), (0.9, 2.0), (-2.0, 0.8)):
        label = f"z = {h} xy from {height}"
        yield case(label, "the same place in any order", 1e-9, warped, height, h)
