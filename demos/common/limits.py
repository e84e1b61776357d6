"""Checks that scripts print: a number beside its limit."""

from common.command import say


def within(result, limits):
    """Print numbers with their limits, on rank 0; whether all keep them.

    Args:
        result: Numbers by name.
        limits: Largest absolute value of some of them.
    """
    width = max(map(len, limits)) + 2
    good = {name: abs(result[name]) <= limit for name, limit in limits.items()}
    for name, limit in limits.items():
        verdict = "ok" if good[name] else "NOT KEPT"
        say(f"check  {name:{width}}{result[name]: .2e}  limit {limit:.0e}  {verdict}")
    return all(good.values())
