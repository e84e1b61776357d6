"""The table of docs/hard-cases.md: every hard case, with every variant.

python3 tests/hard/table.py                                    # all, a line each
python3 tests/hard/table.py --groups stiffness edges           # some
python3 tests/hard/table.py --markdown docs/hard-cases.md      # writes the page's results
"""

import argparse
import importlib
import itertools
import pathlib
import sys

here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here.parent), str(here.parents[1] / "demos")]

from hard.cases import VARIANTS, run  # noqa: E402
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

#: Of the part of the page that is written; what is above it stays.
HEADING = "## Results\n"


def cases(groups=GROUPS):
    """All cases and the variants that they are solved with."""
    modules = [importlib.import_module(f"hard.{group}") for group in groups]
    return [(case, v) for module in modules for v in VARIANTS for case in module.cases(v)]


def write(results):
    """The Markdown: a line for each case, then what is not as it should be."""
    yield f"""
Written by `python3 tests/hard/table.py --markdown docs/hard-cases.md`. A line stands for
{len(VARIANTS)} variants, formulation × quadrature × enforcement:
how many give the right answer, the largest error (and what it may be) over these, and
their most Newton iterations, over all solves of a case. Variants that are refused, with
the unknowns as they were before, or wrong, are listed below the table.

| case | | right | error | allowed | Newton |
|---|---|---|---|---|---|"""
    groups: dict[tuple[str, str], list] = {}
    for r in results:
        groups.setdefault((r.case.name, r.case.label), []).append(r)
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
        yield f"| {shown} | {label} | {count} | {error} | {allowed} | {most} |"
        last = name
    yield "\n### Not as they should be\n"
    bad = [r for r in results if not r.expected]
    said = lambda r: (r.case.name, r.case.label, r.status, r.message.split("; residuals")[0])  # noqa: E731
    order = list(groups)
    bad.sort(key=lambda r: (order.index((r.case.name, r.case.label)), said(r)))
    for (name, label, status, message), alike in itertools.groupby(bad, said):
        found = list(alike)
        variants = "; ".join(str(r.variant) for r in found)
        errors = [r.error for r in found if r.error is not None]
        worst = f" {max(errors):.1e} ({found[0].case.what})" if errors else ""
        text = f"- **{name}, {label}** ({variants}): {status}: {message.removesuffix('.')}{worst}."
        yield " ".join([text, *filter(None, [found[0].case.known])])


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=GROUPS, metavar="NAME")
    parser.add_argument("--markdown", metavar="FILE")
    a = parser.parse_args()
    results = []
    for case, variant in cases(a.groups):
        results.append(run(case, variant))
        if WORLD.rank == 0:
            print(results[-1], flush=True)
    if WORLD.rank > 0:
        return
    wrong = [r for r in results if not (r.expected or r.case.known)]
    print(f"{len(results)} cases, {sum(r.expected for r in results)} as they should be")
    if a.markdown:
        path = pathlib.Path(a.markdown)
        words = path.read_text(encoding="utf-8").partition(HEADING)[0] if path.exists() else ""
        text = "\n".join(write(results)) + "\n"
        path.write_text(words + HEADING + text, encoding="utf-8")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
