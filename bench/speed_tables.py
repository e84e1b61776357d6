"""Tables of bench/speed_report.py."""

import numpy as np
from speed_front import FLOOR, NEAR, front, kind_of, points, standings


def number(value):
    """Two digits, such as 4.1e-2."""
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}" if value > 0 else "0"


def seconds(value):
    """Three digits."""
    return f"{value:.3g}"


def name(kind):
    """Of a kind in words."""
    enforcement = "penalty" if kind.enforcement == "penalty" else "AL"
    return f"{kind.formulation} {kind.quadrature} {enforcement}"


def case_table(result):
    """Errors, seconds and share of contact of every kind and level."""
    columns = list(result["rows"][0]["errors"]) or sorted(
        {key for row in result["rows"] for key in row.get("errors", {})}
    )
    best = {m: {(p.kind, p.level) for p in front(points(result, m))} for m in result["measures"]}
    heads = []
    for level in result["levels"]:
        row = next(r for r in result["rows"] if r["level"] == level)
        heads.append(f"h = {row['h']:.3g}, {row['dofs']:,} unknowns")
    lines = ["| | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for kind in dict.fromkeys(map(kind_of, result["rows"])):
        cells = []
        for level in result["levels"]:
            row = next(r for r in result["rows"] if r["level"] == level and kind_of(r) == kind)
            cells.append(cell(row, columns, any((kind, level) in b for b in best.values())))
        lines.append(f"| {name(kind)} | " + " | ".join(cells) + " |")
    said = ", ".join(f"{c} side" if c in ("slave", "master") else f"{c} norm" for c in columns)
    return (
        f"Errors ({said.replace(', ', ' / ')}), CPU seconds and share of contact in them; **bold** "
        "is on the front:\n\n" + "\n".join(lines)
    )


def cell(row, columns, bold):
    """One solve."""
    if row["status"] == "no solution":
        return f"no solution ({seconds(row['cpu_seconds'])} s)"
    if row["status"] != "ok":
        return f"not tried: {row['reason']}"
    errors = " / ".join(number(row["errors"][c]) for c in columns)
    text = f"{errors}, {seconds(row['cpu_seconds'])} s, {100 * row['contact_share']:.0f} %"
    return f"**{text}**" if bold else text


def comparisons(results):
    """All pairs of case and measure, and what they are called."""
    for result in results:
        for measure in result["measures"]:
            several = len(result["measures"]) > 1
            yield result, measure, result["title"] + (f" ({measure})" if several else "")


def summary_table(results, among=None):
    """Distance from the front of every kind in every comparison."""
    pairs = list(comparisons(results))
    found = [standings(result, measure, among) for result, measure, _ in pairs]
    lines = [
        "| | " + " | ".join(title for *_, title in pairs) + " |",
        "|---" * (len(pairs) + 1) + "|",
    ]
    for kind in found[0]:
        cells = [distance(standing[kind]) for standing in found]
        lines.append(f"| {name(kind)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def ratio_table(results, pairs):
    """Error and time of a kind over those of another one, on the finest level both have.

    Args:
        results: Those of all cases.
        pairs: Heads of columns, and two kinds for each.
    """
    lines = ["| | " + " | ".join(pairs) + " |", "|---" * (len(pairs) + 1) + "|"]
    columns = [ratios(results, *kinds) for kinds in pairs.values()]
    for *_, title in comparisons(results):
        cells = []
        for column in columns:
            error, time = column.get(title, (np.nan, np.nan))
            shown = f"{error:.2f}" if 1e-3 < error < 1e3 else number(error)
            cells.append(f"{shown} × error, {time:.2f} × time" if error > 0 else "–")
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def ratios(results, kind, other):
    """Error and time of a kind over those of another one, for each comparison."""
    out = {}
    for result, measure, title in comparisons(results):
        at = {(p.kind, p.level): p for p in points(result, measure)}
        levels = [level for k, level in at if k == kind and (other, level) in at]
        if levels:
            mine, its = at[kind, max(levels)], at[other, max(levels)]
            out[title] = (mine.error / its.error, mine.seconds / its.seconds)
    return out


def distance(standing):
    """One kind in one comparison."""
    if standing.missing == 0:
        missing = ""
    else:
        missing = f", no solution on {standing.missing} of {standing.levels + standing.missing}"
    if not np.isfinite(standing.distance):
        return "no solution"
    text = "front" if standing.distance <= 1 else f"{standing.distance:.2f}"
    text = f"**{text}**" if standing.distance <= NEAR else text
    exact = standing.error <= FLOOR
    return f"{text} ({'exact' if exact else number(standing.error)}{missing})"
