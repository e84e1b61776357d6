"""Write the table of docs/hard-cases.md: every hard case, with every variant.

python3 tests/hard/table.py                                    # all, a line each
python3 tests/hard/table.py --groups stiffness edges           # some
python3 tests/hard/table.py --markdown docs/hard-cases.md      # writes the page's results
"""

import argparse
import dataclasses
import importlib
import itertools
import pathlib
import sys

here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here.parent), str(here.parents[1] / "demos")]

from hard.cases import VARIANTS, iterative, run  # noqa: E402
from scenes import WORLD  # noqa: E402

GROUPS = (
    "stiffness",
    "geometry",
    "traps",
    "lost_and_found",
    "chatter",
    "overclosure",
    "free_bodies",
    "edges",
    "motion",
    "meeting",
    "flow",
    "energy",
)

#: Allowed error where linear solves end with forces in balance to 1e-9.
BALANCED = 1e-6

#: Heading of the part of the page that is written; the text above it is kept.
HEADING = "## Results\n"


def cases(groups=GROUPS):
    """Return all cases and their variants."""
    modules = [importlib.import_module(f"hard.{group}") for group in groups]
    return [(case, v) for module in modules for v in VARIANTS for case in module.cases(v)]


def write(results, others):
    """Yield the Markdown: a line for each case, then the unexpected results.

    Args:
        results: Results of the cases.
        others: Results of the same cases with iterative solvers.
    """
    yield f"""
Written by `python3 tests/hard/table.py --markdown docs/hard-cases.md`. Each line summarises
{len(VARIANTS)} variants, formulation × quadrature × enforcement:
how many give the right answer, their largest error (and the allowed error), and
their largest number of Newton iterations over all solves of a case, with the solver that
`"auto"` chooses. The last column is the number of variants with the expected result if multigrid
(flow: a Schur complement) is used for any size, with a direct solver as fallback (errors may then
be 1e-6, or ten times the allowed error, since linear solves end at a tolerance). Variants that are
wrong, or that are refused with unchanged unknowns, are listed below the table.

| case | | right | error | allowed | Newton | right with multigrid |
|---|---|---|---|---|---|---|"""
    groups: dict[tuple[str, str], list] = {}
    iterative_groups: dict[tuple[str, str], list] = {}
    for r, other in zip(results, others, strict=True):
        groups.setdefault((r.case.name, r.case.label), []).append(r)
        iterative_groups.setdefault((r.case.name, r.case.label), []).append(other)
    last = ""
    for (name, label), group in groups.items():
        good = [r for r in group if r.expected]
        what = max((r.case.what for r in group), key=len)
        count = f"{len(good)} of {len(group)}{' refused' * bool(group[0].case.refusal)}"
        error, allowed, most = "", "", ""
        if errors := [r.error for r in good if r.error is not None]:
            error, allowed = (
                f"{max(errors):.1e} ({what})",
                f"{max(r.case.allowed for r in group):.0e}",
            )
            most = max(r.iterations for r in good)
        shown = name if name != last else ""
        with_multigrid = sum(r.expected for r in iterative_groups[name, label])
        yield f"| {shown} | {label} | {count} | {error} | {allowed} | {most} | {with_multigrid} |"
        last = name
    yield "\n### Unexpected results\n"
    yield from listed(results, list(groups))
    yield "\n### Unexpected results only with multigrid\n"
    pairs = zip(results, others, strict=True)
    yield from listed([other for r, other in pairs if r.expected], list(groups)) or ["None."]


def listed(results, order):
    """Return lines for unexpected results; variants with the same result share a line."""
    bad = [r for r in results if not r.expected]
    said = lambda r: (r.case.name, r.case.label, r.status, r.message.split("; residuals")[0])  # noqa: E731
    bad.sort(key=lambda r: (order.index((r.case.name, r.case.label)), said(r)))
    lines = []
    for (name, label, status, message), alike in itertools.groupby(bad, said):
        found = list(alike)
        variants = "; ".join(str(r.variant) for r in found)
        errors = [r.error for r in found if r.error is not None]
        worst = f"{max(errors):.1e} ({found[0].case.what})" if errors else ""
        text = " ".join(filter(None, [message.removesuffix("."), worst])) + "."
        why = f" {found[0].case.known}" if found[0].case.known else ""
        lines.append(f"- **{name}, {label}** ({variants}): {status}: {text}{why}")
    return lines


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=GROUPS, metavar="NAME")
    parser.add_argument("--markdown", metavar="FILE")
    a = parser.parse_args()
    results, others = [], []
    for case, variant in cases(a.groups):
        results.append(run(case, variant))
        with iterative():
            within = dataclasses.replace(case, allowed=max(10 * case.allowed, BALANCED), most=1000)
            others.append(run(within, variant))
        if WORLD.rank == 0:
            print(results[-1], flush=True)
            if not others[-1].expected and results[-1].expected:
                print("with multigrid:", others[-1], flush=True)
    if WORLD.rank > 0:
        return
    wrong = [r for r in results if not (r.expected or r.case.known)]
    wrong += [
        other for r, other in zip(results, others, strict=True) if r.expected > other.expected
    ]
    good = sum(r.expected for r in results), sum(r.expected for r in others)
    print(f"{len(results)} cases, {good[0]} as they should be, with multigrid {good[1]}")
    if a.markdown:
        path = pathlib.Path(a.markdown)
        words = path.read_text(encoding="utf-8").partition(HEADING)[0] if path.exists() else ""
        text = "\n".join(write(results, others)) + "\n"
        path.write_text(words + HEADING + text, encoding="utf-8")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
