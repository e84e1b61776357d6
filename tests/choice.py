"""Which cases of a test are run after each change, and with how many ranks."""

import itertools
import pathlib
import zlib


def indices(item):
    """Number of the value that each parameter of a case has, by the parameter's name."""
    return item.callspec.indices if hasattr(item, "callspec") else {}


def chosen(cases):
    """Numbers of the cases that are run after each change, of those of one test.

    Of a product of two lists of parameters every value is there, of three and more every pair of
    values. A single list is run as it is.

    Args:
        cases: What ``indices`` gives, for each case.
    """
    columns = {tuple(case[name] for case in cases) for name in cases[0]}
    columns = sorted(column for column in columns if len(set(column)) > 1)
    if len(columns) < 2:
        return range(len(cases))
    places = list(itertools.combinations(range(len(columns)), min(2, len(columns) - 1)))
    has = [{(c, tuple(columns[k][i] for k in c)) for c in places} for i in range(len(cases))]
    left, kept = set().union(*has), []
    while left:
        best = max(range(len(cases)), key=lambda i: len(has[i] & left))
        kept.append(best)
        left -= has[best]
    return sorted(kept)


#: Folders of tests with one rank: they read files, run scripts of one rank, or start programs.
ALONE = ("bench", "project")
#: Folders whose files are dealt as a whole, to 1 and 2 ranks: their tests look at the same solves.
TOGETHER = ("problems",)
#: Of ten tests, how many `make test` runs with 1, 2 and 3 ranks.
DEAL = (5, 3, 2)


def needs_several(item):
    """Whether a test is marked as one for several ranks."""
    return any(item.get_closest_marker(mark) for mark in ("several_ranks", "parallel"))


def ranks_of(item):
    """Number of ranks with which `make test` runs a test: by its name, so that it stays."""
    path = pathlib.Path(item.path)
    if path.parent.name in ALONE or item.get_closest_marker("one_rank"):
        return 1
    together = path.parent.name in TOGETHER
    if together:
        several = any("ranks" in name for name in vars(item.module))
    else:
        several = needs_several(item) or "ranks" in item.name
    shares = DEAL[:2] if together else DEAL
    shares = (0, *shares[1:]) if several else shares
    name = path.name if together else item.nodeid
    place = zlib.crc32(name.encode()) % sum(shares)
    return next(n for n, end in enumerate(itertools.accumulate(shares), 1) if place < end)
