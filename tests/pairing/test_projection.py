"""Closest points on single facets."""

import numpy as np
import pytest
import scipy.optimize

import qsdolfinx._cpp as _cpp


def shape_functions(num_vertices, xi):
    s, t = xi
    if num_vertices == 2:
        return np.array([1 - s, s])
    if num_vertices == 3:
        return np.array([1 - s - t, s, t])
    return np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])


def closest_by_search(vertices, p):
    """Return the smallest distance on a fine grid, refined by a bounded minimiser."""
    nv = len(vertices)
    grid = np.linspace(0, 1, 41)
    best = []
    for s in grid:
        for t in [0.0] if nv == 2 else grid:
            if nv != 3 or s + t <= 1 + 1e-12:
                distance = np.linalg.norm(shape_functions(nv, (s, t)) @ vertices - p)
                best.append((distance, s, t))
    best.sort()

    def square(xi):
        return np.sum((shape_functions(nv, xi) @ vertices - p) ** 2)

    found = best[0][0]
    for _, s, t in best[:2]:
        constraint = [{"type": "ineq", "fun": lambda xi: 1 - xi[0] - xi[1]}] if nv == 3 else []
        result = scipy.optimize.minimize(
            square,
            (s, t),
            method="SLSQP",
            bounds=[(0, 1), (0, 0 if nv == 2 else 1)],
            constraints=constraint,
            options={"ftol": 1e-16, "maxiter": 200},
        )
        xi = np.clip(result.x, 0, 1)
        if nv != 3 or xi.sum() <= 1:
            found = min(found, np.sqrt(square(xi)))
    return found


@pytest.mark.parametrize("num_vertices", (2, 3, 4))
@pytest.mark.parametrize("reach", (0.2, 1.0, 5.0))
def test_closest_point(num_vertices, reach):
    """The point is on the facet and as close as a search finds, also on warped facets."""
    rng = np.random.default_rng(num_vertices)
    corners = {2: [[0, 0, 0], [1, 0, 0]], 3: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}
    corners[4] = [*corners[3], [1, 1, 0]]
    for _ in range(40):
        vertices = np.array(corners[num_vertices], dtype=float)
        vertices += 0.25 * rng.uniform(-1, 1, vertices.shape)
        p = np.array([0.5, 0.5, 0]) + reach * rng.uniform(-1, 1, 3)
        distance, xi, x = _cpp.closest_point(num_vertices, vertices, p)
        np.testing.assert_allclose(x, shape_functions(num_vertices, xi) @ vertices, atol=1e-14)
        assert np.isclose(distance, np.linalg.norm(x - p), rtol=1e-13)
        assert min(xi) >= 0 and max(xi) <= 1 and (num_vertices != 3 or sum(xi) <= 1 + 1e-14)
        assert distance <= closest_by_search(vertices, p) * (1 + 1e-9)


@pytest.mark.parametrize("warp", (0.02, 0.1))
def test_gently_warped_quadrilaterals(warp):
    """Slightly warped facets have one minimum: no point of a fine grid is closer."""
    rng = np.random.default_rng(7)
    s, t = (a.ravel() for a in np.meshgrid(*[np.linspace(0, 1, 201)] * 2))
    shapes = shape_functions(4, (s, t)).T
    for _ in range(60):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
        vertices += warp * rng.uniform(-1, 1, vertices.shape)
        # Above the interior, and beyond edges and corners.
        p = np.array([0.5, 0.5, 0]) + [0.8, 0.8, 0.6] * rng.uniform(-1, 1, 3)
        distance, xi, x = _cpp.closest_point(4, vertices, p)
        assert np.isclose(distance, np.linalg.norm(x - p), rtol=1e-13)
        assert distance <= np.linalg.norm(shapes @ vertices - p, axis=1).min() * (1 + 1e-13)
        # The point is stationary: the residual is normal to the patch, or points outwards at an
        # edge.
        a, b = vertices[1] - vertices[0], vertices[2] - vertices[0]
        c = vertices[3] - vertices[1] - b
        for i, tangent in enumerate((a + xi[1] * c, b + xi[0] * c)):
            slope = (x - p) @ tangent
            assert (xi[i] > 0 or slope > -1e-12) and (xi[i] < 1 or slope < 1e-12)
            assert not 0 < xi[i] < 1 or abs(slope) < 1e-12


@pytest.mark.parametrize("num_vertices", (2, 3, 4))
def test_points_of_the_facet_are_their_own_projection(num_vertices):
    rng = np.random.default_rng(5)
    for _ in range(50):
        vertices = rng.normal(size=(num_vertices, 3))
        if num_vertices == 4:
            vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) + 0.2 * vertices
        xi = rng.dirichlet([1, 1, 1])[:2] if num_vertices < 4 else rng.random(2)
        if num_vertices == 2:
            xi[1] = 0
        p = shape_functions(num_vertices, xi) @ vertices
        distance, _, x = _cpp.closest_point(num_vertices, vertices, p)
        assert distance < 1e-12
        np.testing.assert_allclose(x, p, atol=1e-12)


def test_a_point_as_far_as_can_be_still_gets_an_answer():
    """With all points of a patch equally far, Newton's matrix is bad and the result is right."""
    a = np.sqrt(1 / 3)
    vertices = np.array([[-a, -a, a], [a, -a, a], [-a, a, a], [a, a, a]])
    distance, xi, _ = _cpp.closest_point(4, vertices, np.zeros(3))
    assert np.isclose(distance, a)
    np.testing.assert_allclose(xi, 0.5, atol=1e-9)
    with pytest.raises(ValueError, match="vertices"):
        _cpp.closest_point(5, np.zeros((5, 3)), np.zeros(3))
