"""Compare errors with their limits."""

from common.command import print_rows


def check(result, limits):
    """Print errors and their limits, on rank 0, and check them.

    Args:
        result: Results by name, the same on all ranks.
        limits: Largest absolute values, by name.

    Raises:
        AssertionError: If an error exceeds its limit.
    """
    rows = [{"name": name, "error": result[name], "limit": limit} for name, limit in limits.items()]
    print_rows(rows, name=("checked", ""), error=("error", ".2e"), limit=("limit", ".1e"))
    exceeded = [name for name, limit in limits.items() if not abs(result[name]) <= limit]
    assert not exceeded, f"above their limits: {exceeded}"
