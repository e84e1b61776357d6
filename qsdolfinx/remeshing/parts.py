"""Find the parts of a closed boundary: bodies, and voids within them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.remeshing.outline import enclosed_volume

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def find_parts(x: Array, facets: Indices) -> list[list[Indices]]:
    """Facets (numbers) of each body's outer boundary, followed by those of the voids within it.

    Args:
        x: Coordinates, shape (nodes, 3).
        facets: Outward facets, shape (facets, gdim).
    """
    shells = _connected(facets, len(x))
    volumes = [enclosed_volume(x, facets[shell]) for shell in shells]
    outer = [i for i, volume in enumerate(volumes) if volume > 0]
    out = {i: [shells[i]] for i in outer}
    for i, shell in enumerate(shells):
        if i in out:
            continue
        point = x[facets[shell[0], 0]]
        around = [j for j in outer if _is_within(point, x, facets[shells[j]])]
        out[min(around or outer, key=lambda j: volumes[j])].append(shell)
    return list(out.values())


def in_voids(x: Array, cells: Indices, of_boundary: Array, facets: Indices) -> Flags:
    """Flags of tetrahedra outside a boundary whose facets are faces of the cells, shape (cells,).

    Args:
        x: Coordinates of the cells' nodes, shape (nodes, 3).
        cells: Nodes of the cells; boundary nodes have their boundary number plus one.
        of_boundary: Coordinates of the boundary nodes.
        facets: Outward facets of the boundary.
    """
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]], axis=2).reshape(-1, 3)
    walls = np.sort(facets + 1, axis=1)
    _, number = np.unique(np.vstack([walls, faces]), axis=0, return_inverse=True)
    number = number.ravel()
    is_wall = np.zeros(number.max() + 1, dtype=bool)
    is_wall[number[: len(walls)]] = True
    of_faces = number[len(walls) :]
    order = np.argsort(of_faces, kind="stable")
    same = of_faces[order[1:]] == of_faces[order[:-1]]
    pairs = np.stack([order[:-1][same], order[1:][same]], axis=1)
    pairs = pairs[~is_wall[of_faces[pairs[:, 0]]]] // 4
    label = _labels(pairs, len(cells))
    out = np.zeros(len(cells), dtype=bool)
    for found in np.unique(label):
        members = np.flatnonzero(label == found)
        point = x[cells[members[0]]].mean(axis=0)
        out[members] = not _is_within(point, of_boundary, facets)
    return out


def _labels(groups: Indices, count: int) -> Indices:
    """Smallest number in each set of numbers connected by groups, shape (count,)."""
    label = np.arange(count)
    while True:
        lowest = label[groups].min(axis=1)
        new = label.copy()
        for column in groups.T:
            np.minimum.at(new, label[column], lowest)
            np.minimum.at(new, column, lowest)
        new = new[new]
        if np.array_equal(new, label):
            return label
        label = new


def _connected(facets: Indices, num_nodes: int) -> list[Indices]:
    """Groups of facets that are connected by nodes, in the order of their first facet."""
    of_facet = _labels(facets, num_nodes)[facets[:, 0]]
    _, first = np.unique(of_facet, return_index=True)
    return [np.flatnonzero(of_facet == of_facet[f]) for f in np.sort(first)]


def _is_within(point: Array, x: Array, facets: Indices) -> bool:
    """Whether a boundary winds around a point that is not on it."""
    corners = x[facets] - point
    if facets.shape[1] == 2:
        (a0, a1), (b0, b1) = (corners[:, i, :2].T for i in (0, 1))
        turned = np.arctan2(a0 * b1 - a1 * b0, a0 * b0 + a1 * b1).sum()
        return bool(turned > np.pi)
    a, b, c = (corners[:, i] for i in range(3))
    na, nb, nc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    ab, bc, ca = (np.sum(p * q, axis=1) for p, q in ((a, b), (b, c), (c, a)))
    volume = np.sum(a * np.cross(b, c), axis=1)
    angle = 2 * np.arctan2(volume, na * nb * nc + ab * nc + bc * na + ca * nb)
    return bool(angle.sum() > 2 * np.pi)
