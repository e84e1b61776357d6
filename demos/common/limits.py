"""Errors beside what they may be."""

from common.command import print_rows


def check(result, limits):
    """Print errors and their limits, on rank 0.

    Args:
        result: Results by name, the same on all ranks.
        limits: Largest absolute values, by name.

    Raises:
        AssertionError: If one is exceeded.
    """
    rows = [{"name": name, "error": result[name], "limit": limit} for name, limit in limits.items()]
    print_rows(rows, name=("checked", ""), error=("error", ".2e"), limit=("limit", ".1e"))
    exceeded = [name for name, limit in limits.items() if not abs(result[name]) <= limit]
    assert not exceeded, f"above their limits: {exceeded}"
