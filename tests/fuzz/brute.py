"""Contact detection by brute force, with NumPy alone: every node against every facet."""

import numpy as np

#: Decisions that a smaller relative change would reverse are not counted as faults.
MARGIN = 1e-7

#: Minimum cosine between normals that count as opposed.
FACING = 0.1


def dot(a, b):
    return np.einsum("...i,...i->...", a, b)


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def on_segment(a, b, p):
    """Closest points of segments, broadcast over leading axes."""
    t = np.clip(dot(p - a, b - a) / dot(b - a, b - a), 0, 1)
    return a + t[..., None] * (b - a)


def nearest(candidates, p):
    """Closest to p of several arrays of points, element by element."""
    stack = np.stack(np.broadcast_arrays(*candidates))
    pick = np.argmin(np.linalg.norm(stack - p, axis=-1), axis=0)
    return np.take_along_axis(stack, pick[None, ..., None], axis=0)[0]


def on_triangle(a, b, c, p):
    """Closest points of triangles: inside of all edges, or else on the nearest edge."""
    n = unit(np.cross(b - a, c - a))
    q = p - dot(p - a, n)[..., None] * n
    edges = ((a, b), (b, c), (c, a))
    inside = np.all([dot(np.cross(t - s, q - s), n) >= 0 for s, t in edges], axis=0)
    return np.where(inside[..., None], q, nearest([on_segment(s, t, p) for s, t in edges], p))


def on_patch(corners, p, steps=200):
    """Closest points of bilinear patches: exact minimisation along each coordinate in turn.

    It uses several starting points. A minimum that is approached slowly has an error of about 1e-6.
    """
    x0, x1, x2, x3 = corners
    a, b, c = x1 - x0, x2 - x0, x3 - x1 - x2 + x0
    found = [on_segment(*edge, p) for edge in ((x0, x1), (x0, x2), (x1, x3), (x2, x3))]
    shape = np.broadcast_shapes(x0.shape, p.shape)[:-1]
    for start in (0.15, 0.5, 0.85):
        for t0 in (0.15, 0.5, 0.85):
            s, t = np.full(shape, start), np.full(shape, t0)
            for _ in range(steps):
                along = a + t[..., None] * c
                s = np.clip(dot(p - x0 - t[..., None] * b, along) / dot(along, along), 0, 1)
                along = b + s[..., None] * c
                t = np.clip(dot(p - x0 - s[..., None] * a, along) / dot(along, along), 0, 1)
            found.append(x0 + s[..., None] * a + t[..., None] * b + (s * t)[..., None] * c)
    return nearest(found, p)


def closest(p, facets):
    """Closest point of every facet to every node, shape (nodes, facets, 3)."""
    corners = np.moveaxis(facets, 1, 0)[:, None]
    p = p[:, None]
    if len(corners) == 2:
        return on_segment(*corners, p)
    if len(corners) == 3:
        return on_triangle(*corners, p)
    return on_patch(corners, p)


def outward(facets, center):
    """Normals of facets of a convex body at their centres."""
    if facets.shape[1] == 2:
        t = facets[:, 1] - facets[:, 0]
        n = np.stack([t[:, 1], -t[:, 0], 0 * t[:, 0]], axis=1)
    else:
        n = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
        if facets.shape[1] == 4:
            n = np.cross(facets[:, 3] - facets[:, 0], facets[:, 2] - facets[:, 1])
    return unit(n) * np.sign(dot(n, facets.mean(axis=1) - center))[:, None]


def crossed(x, y, facets):
    """Whether the line from x to y, or its continuation by the same length, crosses another facet.

    Intersections at x or at y do not count.
    """
    out = np.zeros(len(x), dtype=bool)
    for corners in facets:
        at_node = np.linalg.norm(corners[:, None] - x, axis=-1).min(axis=0)
        t = first_hits(x, y - x, corners[None], None)
        near = np.linalg.norm(y - x, axis=1) * np.minimum(t, 2 - t)
        size = np.linalg.norm(corners - corners[0], axis=1).max()
        out |= (t < 2) & (np.abs(t - 1) > 1e-6) & (near > 1e-6 * size) & (at_node > 1e-6 * size)
    return out


def sizes_of(facets):
    """Largest distance between two vertices of each facet."""
    return np.linalg.norm(facets[:, :, None] - facets[:, None], axis=-1).max(axis=(1, 2))


def reaches(x, facets, own, radius):
    """Search distance of each node for each facet, shape (nodes, facets).

    Args:
        x: Nodes.
        facets: Facets of the other surface.
        own: Facets of the nodes' surface.
        radius: One for all; "local" for the size of the facet or, if larger, of the facets at the
            node.
    """
    if radius != "local":
        return np.full((len(x), len(facets)), radius)
    at = np.linalg.norm(own[None] - x[:, None, None], axis=-1).min(axis=2)
    own_size = sizes_of(own)
    of_nodes = np.where(at <= 1e-9 * own_size, own_size, 0.0).max(axis=1)
    return np.maximum(of_nodes[:, None], sizes_of(facets))


def nodal_faults(x, normal, facets, center, radius, found, point, own=()):
    """Faults of the contact pairs of nodes: too far, too near, paired or not against the rule.

    Args:
        x: Nodes, shape (nodes, 3).
        normal: Normals at the nodes.
        facets: All facets of the other surface, shape (facets, vertices, 3).
        center: A point inside the other body.
        radius: Search radius, see :func:`reaches`.
        found: Whether each node was paired.
        point: Closest points of the paired nodes.
        own: All facets of the nodes' surface: nodes behind them may be unpaired, and without a
            radius their sizes determine the search distance of the nodes.
    """
    if len(x) == 0:
        return []
    q = closest(x, facets)
    n = outward(facets, center)
    size = sizes_of(facets)
    reach = reaches(x, facets, own, radius)
    slack = 1e-5 if facets.shape[1] == 4 else 1e-9  # normals of a warped patch vary
    angle = 0.3 if facets.shape[1] == 4 and is_warped(facets) else MARGIN
    distance = np.linalg.norm(q - x[:, None], axis=-1)
    facing = normal @ n.T + FACING
    sure = np.where(facing < -angle, distance, np.inf).min(axis=1)
    possible = np.where(facing < angle, distance, np.inf).min(axis=1)
    got = np.where(found, np.linalg.norm(point - x, axis=1), np.inf)
    slack = slack * size.max()
    out = []
    elsewhere = is_outside(x, q, n, distance, facing, size)
    far = found & ~elsewhere
    if np.any(far & (got > np.maximum(sure, 0) + slack)):
        out.append(f"paired too far away, by {np.max((got - sure)[far]):.1e}")
    if np.any(found & (got < possible - slack)):
        out.append(f"nearer than any facet, by {np.max((possible - got)[found]):.1e}")
    here = (np.abs(distance - got[:, None]) <= slack) & (facing < angle)
    if np.any(found & (got > np.where(here, reach, 0).max(axis=1) * (1 + 1e-12))):
        out.append("paired beyond the radius")
    # Nodes that are unpaired although admissible facets are near, and that lie beside none of them.
    offset = tangential_offset(x[:, None] - q, n[None])
    height = np.abs(dot(x[:, None] - q, n[None]))
    within = offset < (1 - MARGIN) * 0.1 * size
    within |= (offset < (1 - MARGIN) * 2 * height) & (to_rim(q, facets) > 1e-6 * size)
    near = (distance <= possible[:, None] + slack) & (facing < angle)
    good = np.all(within | ~near, axis=1) & (sure <= possible + slack)
    good &= sure < np.where(near, reach, np.inf).min(axis=1) * (1 - 1e-9)
    good[good & ~found] &= ~hidden(x, q, facing, distance, facets, own)[good & ~found]
    good &= ~elsewhere
    left = np.flatnonzero(good & ~found)
    good[left] = ~has_shorter_way_out(x, normal, q, n, facing, facets, own, left)
    good[left] &= ~is_behind_the_edge(x, q, n, distance, facing)[left]
    if angle == MARGIN and np.any(good & ~found):
        out.append(f"{np.count_nonzero(good & ~found)} nodes were left unpaired")
    return out


def is_outside(x, q, n, distance, facing, size):
    """Whether nodes behind the plane of the nearest facet that faces them are still outside.

    Their closest point is on the edge of this facet, and they are in front of another facet that is
    as near and does not face them.
    """
    nodes = np.arange(len(x))
    nearest = np.argmin(np.where(facing < 0, distance, np.inf), axis=1)
    height = dot(x[:, None] - q, n[None])
    offset = tangential_offset(x[:, None] - q, n[None])[nodes, nearest]
    behind = (height[nodes, nearest] < 0) & (offset > 1e-6 * size[nearest])
    as_near = distance <= distance[nodes, nearest, None] * (1 + 1e-6)
    return behind & np.any(as_near & (height > 0) & (facing >= 0), axis=1)


def is_behind_the_edge(x, q, n, distance, facing):
    """Whether the nearest facet that faces a node has a neighbour there with its back to the node.

    A line of sight just touches this neighbour, which may or may not hide the facet.
    """
    nodes = np.arange(len(x))
    nearest = np.argmin(np.where(facing < 0, distance, np.inf), axis=1)
    as_near = np.abs(distance - distance[nodes, nearest, None]) <= 1e-6 * distance
    return np.any(as_near & (dot(x[:, None] - q, n[None]) < 0) & (facing >= 0), axis=1)


def has_shorter_way_out(x, normal, q, n, facing, facets, own, nodes):
    """Whether opposite lateral faces together are less deep than the nearest facet.

    Args:
        x: All nodes; other arguments as for :func:`nodal_faults`.
        nodes: Nodes to check.
    """
    out = np.zeros(len(nodes), dtype=bool)
    if len(nodes) == 0:
        return out
    own_n = outward(own, own.mean(axis=(0, 1)))
    at = np.argmin(np.linalg.norm(own.mean(axis=1)[:, None] - x, axis=-1), axis=1)
    own_n = own_n * np.sign(dot(own_n, normal[at]))[:, None]
    distance = np.linalg.norm(q - x[:, None], axis=-1)
    for i, k in enumerate(nodes):
        f = np.argmin(np.where(facing[k] < 0, distance[k], np.inf))
        y, depth = q[k, f], distance[k, f]
        if (y - x[k]) @ n[f] <= 0:
            continue
        from_x = across(x[k], facets, n, n[f], depth)
        from_y = across(y, own, own_n, n[f], depth)
        out[i] = any(
            a + b < depth * (1 + 1e-6) and u @ v < -0.86 for a, u in from_x for b, v in from_y
        )
    return out


def across(p, facets, normals, axis, depth):
    """Distances and normals of facets lateral to an axis that have a point behind them."""
    q = closest(p[None], facets)[0]
    distance = np.linalg.norm(q - p, axis=1)
    behind = dot(p - q, normals) < 1e-6 * depth
    keep = (np.abs(normals @ axis) < 0.5 + MARGIN) & (distance < depth) & behind
    return list(zip(distance[keep], normals[keep], strict=True))


def hidden(x, q, facing, distance, facets, own):
    """Whether facets may lie between the nodes and the nearest facet that faces them."""
    nearest = np.argmin(np.where(facing < 0, distance, np.inf), axis=1)
    y = q[np.arange(len(x)), nearest]
    return crossed(x, y, [*facets, *own])


def to_rim(q, facets):
    """Distance of points, shape (nodes, facets, 3), to the surface's rim; inf if it has none."""
    sides = {2: ((0,), (1,)), 3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 1), (0, 2), (1, 3), (2, 3))}
    edges = np.concatenate([facets[:, list(side)] for side in sides[facets.shape[1]]])
    size = np.ptp(facets.reshape(-1, facets.shape[-1]), axis=0).max()
    names = [tuple(sorted(map(tuple, np.round(edge / size, 9) + 0.0))) for edge in edges]
    edges = [edge for edge, name in zip(edges, names, strict=True) if names.count(name) == 1]
    out = np.full(q.shape[:-1], np.inf)
    for edge in edges:
        nearby = on_segment(*edge, q) if len(edge) == 2 else edge[0]
        out = np.minimum(out, np.linalg.norm(q - nearby, axis=-1))
    return out


def is_warped(facets):
    c = facets[:, 3] - facets[:, 1] - facets[:, 2] + facets[:, 0]
    size = np.linalg.norm(facets[:, 3] - facets[:, 0], axis=1)
    return bool(np.any(np.linalg.norm(c, axis=1) > 1e-12 * size))


def tangential_offset(d, n):
    return np.linalg.norm(d - dot(d, n)[..., None] * n, axis=-1)


def first_hits(x, direction, facets, normals):
    """Smallest |t| at which x + t·direction meets a facet that faces it, inf if none does.

    Without normals any facet counts, and only t > 0. For intervals and triangles; parallelograms
    are two triangles.
    """
    best = np.full(len(x), np.inf)
    facing = np.ones((len(x), len(facets)), dtype=bool)
    if normals is not None:
        facing = direction @ normals.T < 0
    for f, corners in enumerate(facets):
        a, b = corners[0], corners[1]
        if len(corners) == 2:
            c = a + np.array([0, 0, 1.0])
            parts = [(a, b, c)]
        else:
            parts = [(a, b, corners[2])]
            parts += [(corners[3], b, corners[2])] if len(corners) == 4 else []
        for u, v, w in parts:
            n = np.cross(v - u, w - u)
            across = dot(direction, n)
            t = dot(u - x, n) / np.where(across == 0, 1e-300, across)
            t = np.clip(t, -1e150, 1e150)
            hit = x + t[:, None] * direction
            s = dot(np.cross(hit - u, w - u), n) / dot(n, n)
            r = dot(np.cross(v - u, hit - u), n) / dot(n, n)
            inside = (s > -1e-9) & (s < 1 + 1e-9)
            if len(corners) > 2:
                inside &= (r > -1e-9) & (s + r < 1 + 1e-9)
            ok = facing[:, f] & inside & ((t > 0) if normals is None else True)
            best = np.where(ok, np.minimum(best, np.abs(t)), best)
    return best
