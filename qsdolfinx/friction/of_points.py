"""What friction at points has that nodes do not tell, as it goes from a pairing to the next."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

#: Degree of polynomials of the place between two facets: with 1, friction of hexahedra that slip in
#: part creeps by three times as much in steps in which nothing moves (test_friction_at_points.py).
DEGREE = 3

#: How far places, functions of the vertices of facets, spread at least for anything to change along
#: them; and standard deviations beyond which nothing does.
LEAST_SPREAD, FARTHEST = 0.01, 2.0

#: Least mean square of a function for it to be told: below it points are too few.
LEAST_SHARE = 1e-3

#: How far places are apart that are the same.
SAME_PLACE = 1e-9

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class OfPoints(typing.NamedTuple):
    """What points of a slip have beyond the multipliers of nodes.

    Attributes:
        keys: What tells apart between which facets they are, (points, n).
        place: Where on the slave's facet: functions of its vertices, (points, vertices).
        rest: τ beyond the nodes' when the step began (stress), (points, gdim).
        normal: Normals, (points, gdim).
    """

    keys: Indices
    place: Array
    rest: Array
    normal: Array


class SavedNormals(typing.NamedTuple):
    """Normals of the pairing that a checkpoint was written with: vectors turn from these.

    That contact is paired anew when it is read, where bodies have come a little further, turns
    nothing: vectors that turn twice are not quite those that turn once.

    Attributes:
        of_nodes: See ``carried.normals_of_nodes``.
        of_points: Of the points that are at the same places now, (points, gdim).
    """

    of_nodes: Array
    of_points: Array


def carried_to(old: OfPoints, keys: Indices, place: Array, normal: Array) -> Array:
    """What the closest point between the same facets had, 0 where there was none, (points, gdim).

    Vectors turn as normals do.

    Args:
        old: Of the points before.
        keys: Of the points now, as those of the old ones.
        place: Likewise.
        normal: Likewise.
    """
    at = closest(old.keys, old.place, keys, place)
    found, out = at >= 0, np.zeros_like(normal)
    before = old.normal[at[found]]
    out[found] = turned(old.rest[at[found]], before, normal[found], normal.shape[1])
    return out


class SmoothRest:
    """What points had beyond nodes, as a smooth function of the place between the same facets.

    It is the polynomial of the place that is closest to what they had, and 0 where there were none.
    What the closest point had would jump as points move, and residuals with it:
    ``tests/sliding/test_walls.py``.

    Args:
        old: Of the points before.
    """

    def __init__(self, old: OfPoints) -> None:
        # Points of a pair of facets follow each other, in one run or a few.
        starts = _starts(old.keys)
        sizes = np.diff(starts, append=len(old.keys))
        self._keys, runs = np.unique(old.keys[starts], axis=0, return_inverse=True)
        runs = runs.ravel()
        of, count = np.repeat(runs, sizes), len(self._keys)
        number = np.bincount(runs, weights=sizes, minlength=count)

        def means(values: Array) -> Array:
            out = np.zeros((count, *values.shape[1:]))
            if len(values):
                np.add.at(out, runs, np.add.reduceat(values, starts, axis=0))
            return out / number.reshape(-1, *(1,) * (values.ndim - 1))

        self._center = means(old.place)
        away = old.place - self._center[of]
        square, axes = np.linalg.eigh(means(away[:, :, None] * away[:, None]))
        along = 1 - old.rest.shape[1]  # the axes along the facet are the last ones
        square, axes = square[:, along:], axes[:, :, along:]
        told = square > LEAST_SPREAD**2
        self._scaled: Array = np.divide(
            axes, np.sqrt(square)[:, None], out=np.zeros_like(axes), where=told[:, None]
        )
        known = self._functions(old.place, of)
        share, parts = np.linalg.eigh(means(known[:, :, None] * known[:, None]))
        inverse = np.divide(1.0, share, out=np.zeros_like(share), where=share > LEAST_SHARE)
        right = np.swapaxes(parts, 1, 2) @ means(known[:, :, None] * old.rest[:, None])
        self._factors: Array = (parts * inverse[:, None]) @ right

    def at(self, keys: Indices, place: Array, turns: Array) -> Array:
        """It, turned, for points elsewhere, (points, gdim).

        Args:
            keys: Of the points, as those of the old ones.
            place: Likewise.
            turns: Matrices that vectors turn by, (points, gdim, gdim).
        """
        out, starts, count = np.zeros(turns.shape[:2]), _starts(keys), len(self._keys)
        _, first, group = np.unique(
            np.concatenate([self._keys, keys[starts]]),
            axis=0,
            return_index=True,
            return_inverse=True,
        )
        at = first[group.ravel()[count:]]  # beyond the known ones where there was none
        of = np.repeat(at, np.diff(starts, append=len(keys)))
        some = np.flatnonzero(of < count)
        functions = self._functions(place[some], of[some])
        values = np.einsum("pk,pki->pi", functions, self._factors[of[some]])
        out[some] = np.einsum("pij,pj->pi", turns[some], values)
        return out

    def _functions(self, place: Array, of: Indices) -> Array:
        """Monomials of the places in standard deviations of those of a pair."""
        along = np.einsum("pk,pkj->pj", place - self._center[of], self._scaled[of])
        return _monomials(np.clip(along, -FARTHEST, FARTHEST))


def _starts(keys: Indices) -> Indices:
    """First points of runs with the same keys."""
    other = np.any(keys[1:] != keys[:-1], axis=1)
    return np.flatnonzero(np.append(len(keys) > 0, other)[: len(keys)])


def _monomials(x: Array) -> Array:
    """All up to the degree in one or two variables, (points, monomials)."""
    powers = [x**k for k in range(DEGREE + 1)]
    if x.shape[1] == 1:
        return np.column_stack(powers)
    pairs = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    return np.column_stack([powers[i][:, 0] * powers[j][:, 1] for i, j in pairs])


def are_same(old: OfPoints, keys: Indices, place: Array) -> bool:
    """Whether these are the points of before, in the same order."""
    return (
        old.keys.shape == keys.shape
        and np.array_equal(old.keys, keys)
        and bool(np.all(np.abs(old.place - place) <= SAME_PLACE))
    )


def closest(known: Indices, places: Array, keys: Indices, place: Array) -> Indices:
    """For each point the closest one with the same keys, or −1, (points,)."""
    count = len(known)
    _, group = np.unique(np.concatenate([known, keys]), axis=0, return_inverse=True)
    group = group.ravel()
    order = np.argsort(group[:count], kind="stable")
    of_known = group[:count][order]
    starts = np.searchsorted(of_known, group[count:], side="left")
    ends = np.searchsorted(of_known, group[count:], side="right")
    out, least = np.full(len(keys), -1, dtype=np.int64), np.full(len(keys), np.inf)
    for i in range(int(np.max(ends - starts, initial=0))):
        some = np.flatnonzero(starts + i < ends)
        candidate = order[starts[some] + i]
        distance = np.sum((places[candidate] - place[some]) ** 2, axis=1)
        closer = distance < least[some]
        out[some[closer]], least[some[closer]] = candidate[closer], distance[closer]
    return out


def turned(vectors: Array, before: Array, now: Array, gdim: int) -> Array:
    """Vectors turned as normals do, by the smallest angle, of the shape that is given.

    Args:
        vectors: Several behind each other in each row, as the normals.
        before: Normals of before, of any length, of the shape of the vectors.
        now: Those of now.
        gdim: Components of a vector.
    """
    v, *normals = (x.reshape(len(x) * (x.shape[1] // gdim), gdim) for x in (vectors, before, now))
    lengths = [np.linalg.norm(n, axis=1, keepdims=True) for n in normals]
    some = (lengths[0] > 0) & (lengths[1] > 0)
    a, b = (
        np.divide(n, length, out=np.zeros_like(n), where=some)
        for n, length in zip(normals, lengths, strict=True)
    )
    cosine = np.sum(a * b, axis=1, keepdims=True)
    # R v = v − (a·v + b·v)/(1 + a·b) (a + b) + 2 (a·v) b
    along, across = np.sum(a * v, axis=1, keepdims=True), np.sum(b * v, axis=1, keepdims=True)
    part = np.divide(along + across, 1 + cosine, out=np.zeros_like(along), where=cosine > -1 + 1e-9)
    out = v - part * (a + b) + 2 * along * b
    return np.where(some, out, v).reshape(vectors.shape)
