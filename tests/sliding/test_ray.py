"""Gaps along rays from fixed points of a facet to another facet, and their derivatives."""

import functools
import itertools

import numpy as np
import pytest

import qsdolfinx._cpp as _cpp

CORNERS = {
    2: np.array([[0, 0], [1, 0]]),
    3: np.array([[0, 0], [1, 0], [0, 1]]),
    4: np.array([[0, 0], [1, 0], [0, 1], [1, 1]]),
}
EDGES = {2: [(0, 1)], 3: [(0, 1), (0, 2), (1, 2)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}

#: Vertices and degree of the segmented facet and of the other; whether the slave is segmented.
KINDS = [
    (cut, other, cut_is_slave)
    for cut, other in itertools.product(itertools.product((2, 3, 4), (1, 2)), repeat=2)
    if (cut[0] == 2) == (other[0] == 2)
    for cut_is_slave in (True, False)
]
kinds = pytest.mark.parametrize("kind", KINDS, ids=str)


def places(num_vertices, degree):
    """Return the nodes of a reference facet."""
    corners = CORNERS[num_vertices].astype(float)
    if degree == 1:
        return corners
    middles = [corners[list(edge)].mean(axis=0) for edge in EDGES[num_vertices]]
    centre = [corners.mean(axis=0)] if num_vertices == 4 else []
    return np.array([*corners, *middles, *centre])


def monomials(num_vertices, degree, xi):
    s, t = np.asarray(xi).T
    powers = range(degree + 1)
    return np.array(
        [
            s**i * t**j
            for i, j in itertools.product(powers, powers)
            if (num_vertices != 2 or j == 0) and (num_vertices != 3 or i + j <= degree)
        ]
    ).T


@functools.cache
def coefficients(num_vertices, degree):
    return np.linalg.inv(monomials(num_vertices, degree, places(num_vertices, degree)))


def functions(num_vertices, degree, xi):
    """Return functions that are 1 at one node of a facet and 0 at the others, [point][node]."""
    return monomials(num_vertices, degree, xi) @ coefficients(num_vertices, degree)


def ray_points(xi, zeta, weight):
    return _cpp.RayPoints(*(np.asarray(a, dtype=float) for a in (xi, zeta, weight)))


class Pair:
    """Two facets with points and weights; ``x`` are the slave's nodes, then the master's."""

    def __init__(self, kind, seed=3, num_points=4):
        self.cut_kind, self.other_kind, self.cut_is_slave = kind
        rng = np.random.default_rng(seed)
        self.dim = 2 if self.cut_kind[0] == 2 else 3

        def facet(kind, height):
            x = np.zeros((len(places(*kind)), 3))
            x[:, :2] = places(*kind)
            if self.dim == 2:
                x[:, 1] = height
            else:
                x[:, 2] = height
            x[:, : self.dim] += rng.uniform(-0.08, 0.08, (len(x), self.dim))
            return x

        cut, other = facet(self.cut_kind, 0.0), facet(self.other_kind, 0.2)
        turn, _ = np.linalg.qr(rng.normal(size=(self.dim, self.dim)))
        x = np.vstack((cut, other) if self.cut_is_slave else (other, cut))
        x[:, : self.dim] = x[:, : self.dim] @ turn.T
        self.x, self.num_cut, self.num_other = x, len(cut), len(other)
        self.orientation = rng.choice((-1.0, 1.0))
        self.xi = rng.uniform(0.15, 0.4, (num_points, 2))
        self.zeta = rng.uniform(0.2, 0.4, (num_points, 2))
        self.weight = rng.uniform(0.5, 1.5, num_points)
        self.pressure = rng.uniform(-1, 1, num_points)
        self.tractions = np.zeros((num_points, 3))
        self.tractions[:, : self.dim] = rng.uniform(-1, 1, (num_points, self.dim))
        #: Nodes where slip began: displaced and rotated.
        turn, _ = np.linalg.qr(np.eye(self.dim) + 0.2 * rng.normal(size=(self.dim, self.dim)))
        self.start = x + 0.0
        self.start[:, : self.dim] = x[:, : self.dim] @ (turn * np.sign(np.diag(turn))).T
        self.start[:, : self.dim] += rng.uniform(-0.1, 0.1, (len(x), self.dim))

    @property
    def slave_kind(self):
        return self.cut_kind if self.cut_is_slave else self.other_kind

    def nodes(self, x):
        """Return the nodes of the segmented facet and of the other facet."""
        if self.cut_is_slave:
            return x[: self.num_cut], x[self.num_cut :]
        return x[self.num_other :], x[: self.num_other]

    def rays(self, x):
        """Return the facets with nodes at ``x``, and the rays between them."""
        y, z = self.nodes(x)
        cut = _cpp.RayFacet(*self.cut_kind, y, self.orientation)
        other = _cpp.RayFacet(*self.other_kind, z)
        points = ray_points(self.xi, self.zeta, self.weight)
        assert _cpp.solve_rays(cut, other, points)
        return cut, other, points

    def gaps(self, x):
        """Return −t of each point."""
        return -self.rays(x)[2].t

    def gradients(self, x):
        cut, other, points = self.rays(x)
        return _cpp.ray_gaps(cut, other, self.cut_is_slave, points)

    def function_gradients(self, x):
        cut, other, points = self.rays(x)
        return _cpp.ray_functions(cut, other, self.cut_is_slave, points)

    def hessian(self, x):
        cut, other, points = self.rays(x)
        return _cpp.ray_curvature(cut, other, self.cut_is_slave, points, self.pressure)

    def slip(self, x):
        """Return slip, normal, gradient and the quantity on which tractions work."""
        cut, other, points = self.rays(x)
        start = (np.ascontiguousarray(nodes) for nodes in self.nodes(self.start))
        slip, normal, *rows = _cpp.ray_slip(cut, other, self.cut_is_slave, points, *start)
        return slip, normal, *(np.moveaxis(of, 2, 1) for of in rows)

    def slip_hessian(self, x):
        cut, other, points = self.rays(x)
        return _cpp.ray_slip_curvature(cut, other, self.cut_is_slave, points, self.tractions)

    def normal(self, x):
        y = self.nodes(x)[0]
        if self.cut_kind[0] == 2:
            n = np.cross(y[1] - y[0], [0, 0, 1])
        elif self.cut_kind[0] == 3:
            n = np.cross(y[1] - y[0], y[2] - y[0])
        else:
            n = np.cross(y[3] - y[0], y[2] - y[1])
        return self.orientation * n / np.linalg.norm(n)

    def samples(self, x):
        """Return functions of both facets' nodes, segmented first, and N_k, [point][function]."""
        zeta = self.rays(x)[2].zeta
        slave = self.xi if self.cut_is_slave else zeta
        return (
            functions(*self.cut_kind, self.xi),
            functions(*self.other_kind, zeta),
            functions(self.slave_kind[0], 1, slave),
        )

    def directions(self):
        """Return all nodes in each direction one after another, [direction][node][3]."""
        for node, component in itertools.product(range(len(self.x)), range(self.dim)):
            direction = np.zeros_like(self.x)
            direction[node, component] = 1
            yield direction

    def differences(self, values, step):
        """Return central differences of values [..], as [..][node][3]; 0 across the plane."""
        found = [(values(self.x + step * d) - values(self.x - step * d)) / (2 * step)
                 for d in self.directions()]  # fmt: skip
        out = np.zeros((*found[0].shape, len(self.x), 3))
        out[..., : self.dim] = np.moveaxis(found, 0, -1).reshape(*found[0].shape, -1, self.dim)
        return out

    def rigid_motions(self):
        """Return translations, then infinitesimal rotations about the origin, [motion][node][3]."""
        axes = np.eye(3)
        turns = axes[2:] if self.dim == 2 else axes
        return (
            np.array([np.broadcast_to(a, self.x.shape) for a in axes[: self.dim]]),
            np.array([np.cross(a, self.x) for a in turns]),
        )


@kinds
def test_ends(kind):
    """Rays end on the other facet, and sums are those of their points."""
    pair = Pair(kind)
    y, z = pair.nodes(pair.x)
    points = pair.rays(pair.x)[2]
    T, M, _ = pair.samples(pair.x)
    ends = T @ y + np.outer(points.t, pair.normal(pair.x))
    assert np.abs(M @ z - ends).max() < 1e-14


@kinds
def test_gradient(kind):
    pair = Pair(kind)
    gradients = pair.gradients(pair.x)
    expected = pair.differences(pair.gaps, 1e-5)
    assert np.abs(gradients - expected).max() < 1e-8 * np.abs(gradients).max()


@kinds
def test_functions(kind):
    """The slave's functions change where a ray of the master ends, and nowhere else."""
    pair = Pair(kind)
    gradients = pair.function_gradients(pair.x)
    expected = pair.differences(lambda x: pair.samples(x)[2], 1e-5)
    assert np.any(gradients) == (not pair.cut_is_slave)
    assert np.abs(gradients - expected).max() < 1e-8


@kinds
def test_hessian(kind):
    pair = Pair(kind)
    hessian = pair.hessian(pair.x)
    force = pair.weight * pair.pressure
    expected = pair.differences(lambda x: np.tensordot(force, pair.gradients(x), axes=1), 1e-5)
    expected = expected.reshape(hessian.shape)
    assert np.abs(hessian).max() > 0.02
    assert np.abs(hessian - expected).max() < 1e-7 * np.abs(hessian).max()
    assert np.abs(hessian - hessian.T).max() < 1e-14 * np.abs(hessian).max()


@kinds
def test_slip(kind):
    """Slip lies in the plane of the segmented facet; its gradient agrees with differences."""
    pair = Pair(kind)
    slip, normal, gradient, _ = pair.slip(pair.x)
    expected = np.moveaxis(pair.differences(lambda x: pair.slip(x)[0], 1e-5), 2, 1)
    sign = 1 if pair.cut_is_slave else -1
    assert np.abs(slip).max() > 0.01
    assert np.abs(normal - sign * pair.normal(pair.x)).max() < 1e-14
    inside = (..., slice(pair.dim), slice(pair.dim))  # in 2D other components are not used
    assert np.abs((gradient - expected)[inside]).max() < 1e-8 * np.abs(gradient).max()


@kinds
def test_works(kind):
    """Tractions do work on the sliding of the ray ends on the facet: Σ a_α δζ_α."""
    pair = Pair(kind)
    works, step = pair.slip(pair.x)[3], 1e-6
    z, zeta = pair.nodes(pair.x)[1], pair.rays(pair.x)[2].zeta

    def place(x):
        at = pair.rays(x)[2].zeta
        return functions(*pair.other_kind, zeta + step * (at - zeta)) @ z / step

    expected = np.moveaxis(pair.differences(place, 1e-4), 2, 1)
    sign = 1 if pair.cut_is_slave else -1
    assert np.abs(works).max() > 0.1
    assert np.abs(sign * works - expected).max() < 1e-5 * np.abs(works).max()


@kinds
def test_slip_hessian(kind):
    """The Hessian is the derivative of the work of in-plane tractions, which rotate along."""
    pair = Pair(kind)

    def in_plane(x):
        n = pair.normal(x)
        return pair.tractions - np.outer(pair.tractions @ n, n)

    pair.tractions = in_plane(pair.x)
    hessian = pair.slip_hessian(pair.x)

    def forces(x):
        return np.einsum("p,pr,pjrc->jc", pair.weight, in_plane(x), pair.slip(x)[3])

    expected = pair.differences(forces, 1e-5).reshape(hessian.shape)
    assert np.abs(hessian).max() > 0.02
    assert np.abs(hessian - expected).max() < 1e-7 * np.abs(hessian).max()


@kinds
def test_rigid_motions(kind):
    """Each point conserves linear and angular momentum: gaps are invariant, slip rotates."""
    pair = Pair(kind)
    gradients, (slip, _, gradient, works) = pair.gradients(pair.x), pair.slip(pair.x)
    translations, rotations = pair.rigid_motions()
    axes = np.eye(3)[2:] if pair.dim == 2 else np.eye(3)
    for motion in np.vstack((translations, rotations)):
        assert np.abs(np.einsum("pjc,jc->p", gradients, motion)).max() < 1e-13
        assert np.abs(np.einsum("pjrc,jc->pr", works, motion)).max() < 1e-13
    for motion in translations:
        assert np.abs(np.einsum("pjrc,jc->pr", gradient, motion)).max() < 1e-13
    for axis, motion in zip(axes, rotations, strict=True):
        turned = np.cross(axis, slip)
        assert np.abs(np.einsum("pjrc,jc->pr", gradient, motion) - turned).max() < 1e-13


@kinds
def test_forces_turn_with_the_bodies(kind):
    """H times a translation is 0; times an infinitesimal rotation it rotates the forces."""
    pair = Pair(kind)
    forces = np.tensordot(pair.weight * pair.pressure, pair.gradients(pair.x), axes=1)
    hessian = pair.hessian(pair.x)
    translations, rotations = pair.rigid_motions()
    for motion in translations:
        assert np.abs(hessian @ motion.ravel()).max() < 1e-12
    axes = np.eye(3)[2:] if pair.dim == 2 else np.eye(3)
    for axis, motion in zip(axes, rotations, strict=True):
        turned = np.cross(axis, forces).ravel()
        assert np.abs(hessian @ motion.ravel() - turned).max() < 1e-12


@pytest.mark.parametrize("kind", [k for k in KINDS if k[0][0] == 2], ids=str)
def test_plane(kind):
    """In 2D no result has a third component."""
    pair = Pair(kind)
    hessian = pair.hessian(pair.x).reshape(len(pair.x), 3, len(pair.x), 3)
    assert not pair.gradients(pair.x)[..., 2].any()
    assert not hessian[:, 2].any() and not hessian[..., 2].any()
    works = pair.slip(pair.x)[3]
    assert not works[:, :, 2].any() and not works[..., 2].any()


@pytest.mark.parametrize("cut_is_slave", (True, False))
def test_known_gap(cut_is_slave):
    """Parallel facets 0.1 apart, open or overlapping, have this gap anywhere."""
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    for place, depth in itertools.product((0, 1000), (-0.1, 0.1)):
        points = ray_points([[0.25, 0.5]], [[0.3, 0.3]], [2.0])
        cut = _cpp.RayFacet(3, 1, flat + place)
        other = _cpp.RayFacet(3, 1, flat + place - [0, 0, depth], -1)
        assert _cpp.solve_rays(cut, other, points)
        gradient = _cpp.ray_gaps(cut, other, cut_is_slave, points)[0]
        assert np.abs(points.zeta - [[0.25, 0.5]]).max() < 1e-12
        assert np.abs(points.t + depth).max() < 1e-12
        along = (1 if cut_is_slave else -1) * np.array([0.25, 0.25, 0.5, -0.25, -0.25, -0.5])
        assert np.abs(gradient[:, 2] - along).max() < 1e-12
        assert np.abs(gradient[:, :2]).max() < 1e-12


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("num_vertices", (2, 3, 4))
def test_no_end(num_vertices, degree):
    """A ray parallel to the other facet has no end point."""
    dim = 2 if num_vertices == 2 else 3
    x = np.zeros((len(places(num_vertices, degree)), 3))
    x[:, :2] = places(num_vertices, degree)
    across = x[:, [1, 0, 2] if dim == 2 else [2, 0, 1]] + [1, 0, 0]
    points = ray_points([[0.3, 0.3]], [[0.3, 0.3]], [1.0])
    cut, other = (_cpp.RayFacet(num_vertices, degree, nodes) for nodes in (x, across))
    assert not _cpp.solve_rays(cut, other, points)
    assert np.isnan(points.t).all()


def test_refused():
    x = np.zeros((3, 3))
    with pytest.raises(ValueError, match="degree 1 or 2"):
        _cpp.RayFacet(3, 3, x)
    with pytest.raises(ValueError, match="3 coordinates a node"):
        _cpp.RayFacet(3, 2, x)
    with pytest.raises(ValueError, match="two coordinates"):
        _cpp.RayPoints(np.zeros((2, 2)), np.zeros((1, 2)), np.ones(2))
    facets = _cpp.RayFacet(2, 1, x[:2]), _cpp.RayFacet(3, 1, x)
    with pytest.raises(ValueError, match="both facets"):
        _cpp.solve_rays(*facets, _cpp.RayPoints(x[:1, :2], x[:1, :2], np.ones(1)))
