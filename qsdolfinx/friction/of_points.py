"""Friction data of points beyond the multipliers of nodes, and their transfer to new points."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import ROUNDING

#: Degree of polynomials of the position between two facets. With 1, friction of hexahedra in
#: partial slip creeps three times as much in steps without motion (test_friction_at_points.py).
DEGREE = 3

#: Least standard deviation of positions (shape functions of the facet vertices, parts of 1) for a
#: function to vary along them: with less, it would be a slope from rounding. And distance from
#: their mean, over the standard deviation, beyond which it is constant: a cubic function grows fast
#: there.
LEAST_SPREAD, FARTHEST = 0.01, 2.0

#: Least mean square of a function, over that of a constant, for its factor to be determined: below
#: it there are too few points, and errors would be magnified.
LEAST_SHARE = 1e-3

#: Exponents of the monomials in two variables.
_PAIRS = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class OfPoints(typing.NamedTuple):
    """Data of the points of a slip beyond the multipliers of nodes.

    Attributes:
        keys: Keys of the pair of facets of each point, (points, n).
        place: Position on the slave's facet: shape functions of its vertices, (points, vertices).
        rest: τ beyond the nodes' multipliers at the start of the step (stress), (points, gdim).
        normal: Normals, (points, gdim).
    """

    keys: Indices
    place: Array
    rest: Array
    normal: Array


def carried_to(old: OfPoints, keys: Indices, place: Array, normal: Array) -> Array:
    """``rest`` of the closest old point between the same facets, 0 without one, (points, gdim).

    Vectors turn as normals do.

    Args:
        old: Data of the old points.
        keys: Keys of the present points, as those of the old points.
        place: Positions of the present points, as those of the old points.
        normal: Normals of the present points, as those of the old points.
    """
    at = closest(old.keys, old.place, keys, place)
    found, out = at >= 0, np.zeros_like(normal)
    before = old.normal[at[found]]
    out[found] = turned(old.rest[at[found]], before, normal[found], normal.shape[1])
    return out


class _Scaled(typing.NamedTuple):
    """Points between facets with old points, and their positions.

    Attributes:
        some: The points.
        of: Numbers of their pairs of facets.
        along: Positions over the standard deviations of a pair, within limits, (variables,
            points).
        inside: Whether they are within the limits, (variables, points).
    """

    some: Indices
    of: Indices
    along: Array
    inside: npt.NDArray[np.bool_]


class SmoothRest:
    """``rest`` of the old points as a smooth function of the position between the same facets.

    It is the least-squares polynomial of the position for the data of the old points, and 0 between
    facets without old points. Data of the closest old point would jump as points move, and the
    residual with them: ``tests/sliding/test_walls.py``.

    Args:
        old: Data of the old points.
    """

    def __init__(self, old: OfPoints) -> None:
        # Points of a pair of facets are consecutive, in one run or a few runs.
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

        center = means(old.place)
        away = old.place - center[of]
        square, axes = np.linalg.eigh(means(away[:, :, None] * away[:, None]))
        along = 1 - old.rest.shape[1]  # the axes along the facet are the last ones
        square, axes = square[:, along:], axes[:, :, along:]
        told = square > LEAST_SPREAD**2
        scaled = np.divide(
            axes, np.sqrt(square)[:, None], out=np.zeros_like(axes), where=told[:, None]
        )
        # Pairs of facets are the last axis, as sums over short axes are slow.
        self._center: Array = np.ascontiguousarray(center.T)
        self._scaled: Array = np.ascontiguousarray(np.moveaxis(scaled, 0, 2))
        known = np.column_stack(_monomials(self._along(old.place, of)[0]))
        share, parts = np.linalg.eigh(means(known[:, :, None] * known[:, None]))
        inverse = np.divide(1.0, share, out=np.zeros_like(share), where=share > LEAST_SHARE)
        right = np.swapaxes(parts, 1, 2) @ means(known[:, :, None] * old.rest[:, None])
        factors = (parts * inverse[:, None]) @ right
        self._factors: Array = np.ascontiguousarray(np.moveaxis(factors, 0, 2))
        self._last: tuple[Indices, Array, _Scaled] | None = None

    def at(self, keys: Indices, place: Array) -> Array:
        """Values of the function at other points, (points, gdim).

        Args:
            keys: Keys of these points, as those of the old points.
            place: Positions of these points, as those of the old points.
        """
        some, of, along, _ = self._place(keys, place)
        out = np.zeros((len(keys), self._factors.shape[1]))
        (found,) = self._sums([_monomials(along)], of)
        out[some] = found.T
        return out

    def slopes(self, keys: Indices, place: Array) -> Array:
        """Derivatives of the function by the position, (points, vertices, gdim).

        Args:
            keys: As for :meth:`at`.
            place: As for :meth:`at`.
        """
        some, of, along, inside = self._place(keys, place)
        out = np.zeros((*place.shape, self._factors.shape[1]))
        by_along = self._sums(_slopes_of_monomials(along), of) * inside[:, None]
        for v, scaled in enumerate(self._scaled):
            out[some, v] = np.sum(scaled.take(of, axis=1)[:, None] * by_along, axis=0).T
        return out

    def _sums(
        self, functions: typing.Sequence[typing.Sequence[Array | None]], of: Indices
    ) -> Array:
        """Sums of functions times the factors of pairs of facets, (sums, gdim, points).

        None is 0.
        """
        out = np.zeros((len(functions), self._factors.shape[1], len(of)))
        for k, factors in enumerate(self._factors):
            of_points = factors.take(of, axis=1)
            for to, row in zip(out, functions, strict=True):
                function = row[k]
                if function is not None:
                    to += function * of_points
        return out

    def _place(self, keys: Indices, place: Array) -> _Scaled:
        """Scaled positions of points, those of the last call for the same arrays."""
        last = self._last
        if last is None or last[0] is not keys or last[1] is not place:
            some, of = self._known(keys)
            self._last = last = keys, place, _Scaled(some, of, *self._along(place[some], of))
        return last[2]

    def _known(self, keys: Indices) -> tuple[Indices, Indices]:
        """Points between facets with old points, and the numbers of these pairs of facets."""
        starts, count = _starts(keys), len(self._keys)
        _, first, group = np.unique(
            np.concatenate([self._keys, keys[starts]]),
            axis=0,
            return_index=True,
            return_inverse=True,
        )
        at = first[group.ravel()[count:]]  # at least count for unknown pairs
        of = np.repeat(at, np.diff(starts, append=len(keys)))
        some = np.flatnonzero(of < count)
        return some, of[some]

    def _along(self, place: Array, of: Indices) -> tuple[Array, npt.NDArray[np.bool_]]:
        """``along`` and ``inside`` of :class:`_Scaled`."""
        along = np.zeros((self._scaled.shape[1], len(of)))
        for at, center, scaled in zip(place.T, self._center, self._scaled, strict=True):
            along += (at - center.take(of)) * scaled.take(of, axis=1)
        return np.clip(along, -FARTHEST, FARTHEST), np.abs(along) < FARTHEST


def _starts(keys: Indices) -> Indices:
    """First points of runs with the same keys."""
    other = np.any(keys[1:] != keys[:-1], axis=1)
    return np.flatnonzero(np.append(len(keys) > 0, other)[: len(keys)])


def _monomials(x: Array) -> list[Array]:
    """All monomials up to the degree in one or two variables (n, points), each (points,)."""
    powers = _powers(x)
    if len(x) == 1:
        return powers[0]
    return [powers[0][i] * powers[1][j] for i, j in _PAIRS]


def _slopes_of_monomials(x: Array) -> list[list[Array | None]]:
    """Derivatives of these monomials by each variable; None for those that are constant."""
    powers = _powers(x)
    if len(x) == 1:
        return [[k * powers[0][k - 1] if k else None for k in range(DEGREE + 1)]]
    return [
        [i * powers[0][i - 1] * powers[1][j] if i else None for i, j in _PAIRS],
        [powers[0][i] * (j * powers[1][j - 1]) if j else None for i, j in _PAIRS],
    ]


def _powers(x: Array) -> list[list[Array]]:
    """Powers of each variable up to the degree, each (points,)."""
    out = []
    for of in x:
        powers = [np.ones_like(of)]
        for _ in range(DEGREE):
            powers.append(powers[-1] * of)
        out.append(powers)
    return out


def are_same(old: OfPoints, keys: Indices, place: Array) -> bool:
    """Whether these are the old points, in the same order."""
    return (
        old.keys.shape == keys.shape
        and np.array_equal(old.keys, keys)
        and bool(np.all(np.abs(old.place - place) <= ROUNDING))
    )


def closest(known: Indices, places: Array, keys: Indices, place: Array) -> Indices:
    """For each point the closest known point with the same keys, or −1, (points,)."""
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
    """Rotate vectors as normals rotate, by the smallest angle; the shape does not change.

    Args:
        vectors: Vectors, several of them in each row, as the normals.
        before: Old normals, of any length, of the shape of the vectors.
        now: Present normals, of the same shape.
        gdim: Number of components of a vector.
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
