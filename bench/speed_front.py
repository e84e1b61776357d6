"""Pareto fronts of error over time, and how far a kind of contact is from them.

A point is one solve: seconds and error. It is on the front if no other one is as fast and as
accurate, and better in one of the two. Since meshes can be had in any size, what lies between two
levels of a kind counts as well, on the straight line in log-log axes: a point's *time factor* is
its time over the least with which any kind reaches its error, its *error factor* its error over the
least that any kind reaches in its time. The smaller one of the two is its distance from the front.
"""

import typing

import numpy as np
from speed_cases import Kind

#: Relative error below which a solution is as good as exact: multipliers are augmented to 1e-8.
FLOOR = 1e-8
#: What counts as near the front.
NEAR = 1.1
#: Error of the worse side, on the finest level, of what is of no use.
USELESS = 0.5


class Point(typing.NamedTuple):
    """One solve."""

    kind: Kind
    level: int
    seconds: float
    error: float


class Standing(typing.NamedTuple):
    """Where a kind is in a comparison; ``distance`` is inf without any solution.

    The distance is the largest of the levels on which the kind is better than on faster ones;
    ``at_best`` is that of the most accurate level.
    """

    on_front: int
    levels: int
    missing: int
    distance: float
    at_best: float
    time_factor: float
    error: float
    seconds: float


def kind_of(row):
    """Of a row of the JSON file."""
    return Kind(*(row[name] for name in Kind._fields))


def points(result, measure):
    """All solves of a case; the error is the worst of those that the measure names."""
    names = result["measures"][measure]
    return [
        Point(
            kind_of(row),
            row["level"],
            row["cpu_seconds"],
            max(FLOOR, *(row["errors"][name] for name in names)),
        )
        for row in result["rows"]
        if row["status"] == "ok"
    ]


def front(candidates):
    """Points that no other one beats, the fastest first."""
    out = []
    for point in sorted(candidates, key=lambda p: (p.seconds, p.error)):
        if not out or point.error < out[-1].error:
            out.append(point)
    return out


def curves(candidates):
    """Logarithms of seconds and errors of the own front of each kind."""
    out = {}
    for kind in {p.kind for p in candidates}:
        own = front([p for p in candidates if p.kind == kind])
        out[kind] = np.log([[p.seconds, p.error] for p in own]).T
    return out


def least_seconds(of_kinds, error):
    """In which any kind reaches an error."""
    goal = np.log(error)
    times = [np.interp(goal, e[::-1], t[::-1], left=np.inf) for t, e in of_kinds.values()]
    return np.exp(min(times))


def least_error(of_kinds, seconds):
    """Which any kind reaches in a time."""
    limit = np.log(seconds)
    return np.exp(min(np.interp(limit, t, e, left=np.inf) for t, e in of_kinds.values()))


def factors(of_kinds, point):
    """Time and error factor; an error that cannot be any less has no error factor."""
    time = point.seconds / least_seconds(of_kinds, point.error)
    error = np.inf if point.error <= FLOOR else point.error / least_error(of_kinds, point.seconds)
    return max(time, 1.0), max(error, 1.0)


def standings(result, measure, among=None):
    """Standing of every kind in a case, in a comparison with some kinds or all."""
    everything = points(result, measure)
    rivals = [p for p in everything if among is None or p.kind in among]
    best, of_kinds = front(rivals), curves(rivals)
    out = {}
    for kind in dict.fromkeys(map(kind_of, result["rows"])):
        if among is not None and kind not in among:
            continue
        mine = [p for p in everything if p.kind == kind]
        own = front(mine)
        pairs = [factors(of_kinds, p) for p in own]
        finest = max(mine, key=lambda p: p.level, default=None)
        out[kind] = Standing(
            sum(p in best for p in own),
            len(mine),
            len(result["levels"]) - len(mine),
            max((min(pair) for pair in pairs), default=np.inf),
            min(pairs[-1]) if pairs else np.inf,
            max((time for time, _ in pairs), default=np.inf),
            finest.error if finest else np.inf,
            finest.seconds if finest else np.inf,
        )
    return out


def faults(results):
    """For each kind why it is not usable in some case: a list, empty where it is."""
    out = {}
    for result in results:
        for measure in result["measures"]:
            for kind, standing in standings(result, measure).items():
                said = out.setdefault(kind, [])
                if standing.missing:
                    text = f"{result['title']}: no solution on {standing.missing} of "
                    text += f"{len(result['levels'])} levels"
                    if text not in said:
                        said.append(text)
                elif standing.error > USELESS:
                    said.append(
                        f"{result['title']}: {measure} wrong by {100 * standing.error:.0f} %"
                    )
    return out
