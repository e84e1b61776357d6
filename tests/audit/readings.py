"""Compare the library's results on a contact with the bodies' own forces, where these are known."""

import dataclasses

import numpy as np
from audit.state import cross_product, everywhere
from fuzz.brute import unit

from dolfinx import fem


@dataclasses.dataclass
class Reader:
    """Reads functions of degree 1 at the vertices of a contact surface.

    Attributes:
        V: Space with the node numbers of the surface.
        surface: State of the surface.
    """

    V: fem.FunctionSpace
    surface: object

    def __call__(self, function):
        """Return values at the surface's vertices, shape (vertices, components). Collective."""
        Q = function.function_space
        values = function.x.array.reshape(-1, Q.dofmap.bs)
        index_map = self.V.dofmap.index_map
        owned = index_map.size_local
        out = np.full((owned + index_map.num_ghosts, values.shape[1]), np.nan)
        out[self.V.dofmap.list[:, corners(self.V)]] = values[Q.dofmap.list[:, corners(Q)]]
        return everywhere(self.V.mesh.comm, out[:owned])[self.surface.vertices]


def corners(V):
    """Return the indices of the vertices within a cell."""
    layout, cell = V.dofmap.dof_layout, V.mesh.topology.cell_name()
    count = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[cell]
    return [layout.entity_dofs(0, v)[0] for v in range(count)]


@dataclasses.dataclass
class Reading:
    """Results of a contact on one side; forces have a third component of 0 in 2D.

    Attributes:
        force: Force on the body, shape (3,).
        moment: Moment about the given point, shape (3,); (0, 0, m) in 2D.
        traction: Traction at the vertices, shape (vertices, 3).
        normal: Part of the traction from the gaps.
        tangential: Part of the traction from friction.
        pressure: Pressure at the vertices, shape (vertices,).
        fields: All functions by name, at the vertices, shape (vertices, components).
    """

    force: np.ndarray
    moment: np.ndarray
    traction: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    pressure: np.ndarray
    fields: dict


def read(contact, side, reader, about):
    """Read the results of a contact on a deformable side. Collective.

    Args:
        contact: The contact.
        side: ``"slave"`` or ``"master"``.
        reader: Reader of the side.
        about: Reference point of moments, shape (3,).
    """
    gdim = contact.slave.gdim
    pad = lambda a: np.pad(a, [(0, 0)] * (np.ndim(a) - 1) + [(0, 3 - gdim)])  # noqa: E731
    parts = [pad(reader(contact.traction(side, part))) for part in
             ("whole", "normal", "tangential")]  # fmt: skip
    moment = contact.moment(side, about[:gdim])
    return Reading(
        pad(contact.force(side)),
        np.concatenate([np.zeros(3 - len(moment)), moment]),
        *parts,
        reader(contact.pressure(side))[:, 0],
        {name: reader(field) for name, field in contact.fields(side).items()},
    )


def vertex_areas(x, facets):
    """Return ∫ N_k ds and, up to the sign, ∫ N_k n ds at vertices: (facets, n), (facets, n, 3).

    Args:
        x: Positions of nodes, shape (nodes, 3).
        facets: Vertices of the facets, shape (facets, 2, 3 or 4).
    """
    c = x[facets]
    n = facets.shape[1]
    if n < 4:
        vectors = cross_product(c) / (n * (n - 1))
        vectors = np.repeat(vectors[:, None], n, axis=1)
        return np.linalg.norm(vectors, axis=2), vectors
    a, b = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
    d = c[:, 3] - c[:, 0] - a - b
    areas, vectors = np.zeros(facets.shape), np.zeros((*facets.shape, 3))
    for s in 0.5 + np.array([-1, 1]) / np.sqrt(12):
        for t in 0.5 + np.array([-1, 1]) / np.sqrt(12):
            across = np.cross(a + t * d, b + s * d) / 4
            shape = np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
            areas += np.linalg.norm(across, axis=1)[:, None] * shape
            vectors += across[:, None] * shape[:, None]
    return areas, vectors


def areas_and_normals(surface, x):
    """Return areas (vertices,) and normals (vertices, 3) of a surface with its nodes at x."""
    areas, vectors = vertex_areas(x, surface.facets)
    sign = np.ones(len(surface.facets))
    # Orientation of a facet's vertices: the same as that of its segments or triangles, or opposite.
    pieces = cross_product(x[surface.pieces]) * surface.sign[:, None]
    outwards = np.zeros((len(surface.facets), 3))
    np.add.at(outwards, surface.parent, pieces)
    sign = np.sign(np.sum(outwards * vectors.sum(axis=1), axis=1))
    at = np.searchsorted(surface.vertices, surface.facets)
    area, normal = np.zeros(len(surface.vertices)), np.zeros((len(surface.vertices), 3))
    np.add.at(area, at, areas)
    np.add.at(normal, at, vectors * sign[:, None, None])
    return area, unit(normal)


@dataclasses.dataclass
class Expected:
    """Reference values for the results on a side.

    Attributes:
        side: The side, with its forces.
        area_x: Nodes of the body for the areas of tractions, shape (nodes, 3).
        normal_x: Nodes of the body for the normals of pressures, shape (nodes, 3).
        moment_x: Nodes of the body for the points where forces act, shape (nodes, 3).
        about: Reference point of moments, shape (3,).
    """

    side: object
    area_x: np.ndarray
    normal_x: np.ndarray
    moment_x: np.ndarray
    about: np.ndarray


def faults(name, reading: Reading, expected: Expected, tolerance, rubs, side_by_itself=True):
    """Yield check, values, bounds and text of comparisons of the results on a side.

    Args:
        name: Name of the side.
        reading: Results on the side.
        expected: Reference values.
        tolerance: Largest force that counts as zero.
        rubs: Whether there is friction.
        side_by_itself: Whether all forces come from the nodes of this side, which have a status.
    """
    side = expected.side
    surface, force = side.own.surface, side.force
    area, _ = areas_and_normals(surface, expected.area_x)
    _, normal = areas_and_normals(surface, expected.normal_x)
    slack = (side.hat_count * tolerance)[:, None]
    off = np.abs(reading.traction * area[:, None] - force)
    yield "traction", np.where(side.held, 0.0, off), slack, f"t S and the force on {name}"
    size = np.linalg.norm(reading.traction, axis=1)
    little = 1e-9 * size.max(initial=0.0) + tolerance / area.max()
    off = np.abs(reading.normal + reading.tangential - reading.traction)
    yield "traction", off, little, f"parts of the traction on {name}"
    along = reading.normal if rubs else reading.traction
    off = np.abs(reading.pressure + np.sum(along * normal, axis=1))
    yield "pressure", off, little, f"p and -t n of {name}"
    if not np.any(side.nodal_held[:, : side.gdim]):
        x = expected.moment_x[surface.nodes]
        moment = np.cross(x - expected.about, side.nodal_force).sum(axis=0)
        reach = np.abs(x - expected.about).max() + side.size
        bound = tolerance * np.sqrt(len(x)) * reach
        yield "moment", np.abs(moment - reading.moment), bound, f"of the forces on {name}"
    for field, values in (
        ("traction", reading.traction[:, : side.gdim]),
        ("pressure", reading.pressure[:, None]),
        ("normal_traction", reading.normal[:, : side.gdim]),
        ("tangential_traction", reading.tangential[:, : side.gdim]),
    ):
        if field in reading.fields:
            off = np.abs(reading.fields[field] - values)
            yield "fields", off, little, f"{field} in the fields of {name}"
    if "status" in reading.fields and side_by_itself:
        # Near a pushed node some node is in contact; friction reaches further than pressures.
        x = side.points[: side.num_vertices]
        near = np.linalg.norm(x[:, None] - x, axis=2) <= 1.1 * side.size
        active = np.any(near & (reading.fields["status"][:, 0] >= 2), axis=1)
        loaded = np.linalg.norm(reading.normal, axis=1) * area > 10 * slack[:, 0]
        yield "fields", loaded & ~active, 0.5, f"force where status is open on {name}"


def changed(name, before: Reading, after: Reading):
    """Yield check, values, bounds and text for results that have changed without a solve."""
    for field in dataclasses.fields(Reading):
        a, b = getattr(before, field.name), getattr(after, field.name)
        pairs = [(field.name, a, b)]
        if isinstance(a, dict):
            pairs = [(key, a[key], b[key]) for key in a]
        for what, was, now in pairs:
            off = np.abs(np.asarray(now) - np.asarray(was))
            bound = 1e-12 + 1e-9 * np.abs(was).max()
            yield "update", off, bound, f"{what} of {name} after update()"
