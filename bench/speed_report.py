"""docs/speed-vs-error.md and its figures, made of what bench/speed_vs_error.py has measured.

python3 bench/speed_report.py
python3 bench/speed_report.py --json-dir FOLDER --document FILE --figures FOLDER
"""

import argparse
import json
import os
import pathlib
import sys
import textwrap

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from speed_figures import plot
from speed_front import faults
from speed_tables import case_table, summary_table
from speed_words import floor_note, pairs, words

HERE = pathlib.Path(__file__).resolve().parent
ORDER = ("patch", "hertz2d", "hertz3d", "upsetting", "forging")

HEAD = """# Speed against error

Every formulation, quadrature and enforcement (penalty; AL: augmented Lagrangian) on several mesh
levels of five cases: what a solve costs, and how wrong the contact traction is. Made by

    {commands}
    python3 bench/speed_report.py

of `bench/results/speed_vs_error_*.json`; no number is typed by hand. Seconds are CPU seconds of all
ranks, waiting included, from the bodies in hand to the solution (pairing to solve; no meshes, no
errors), the least of up to three runs. Errors are those of the recovered traction in L2, of the
**worse** of the two sides unless another measure is named. Penalties and tolerances are the
library's automatic ones, if a case says nothing else.

{circumstances}

**Distance from the front.** A solve is on the Pareto front if no other one is as fast and as
accurate. What lies between two levels counts too, on a straight line in log-log axes. A kind's
distance is the factor by which it would have to be faster *or* more accurate, whichever is less, on
the worst of its levels; levels that are no more accurate than a faster one do not count.
{floor} A few milliseconds are
much of the smallest solves: 10 % of time mean nothing there.
"""


def circumstances(results):
    """Machine, versions and date, once for all cases that have the same."""
    groups = {}
    for result in results:
        machine, versions = result["machine"], result["versions"]
        text = (
            f"{machine['cpu']}, {machine['cores']} cores, {result['ranks']} "
            f"rank{'s' if result['ranks'] > 1 else ''}; DOLFINx {versions['dolfinx']}, "
            f"PETSc {versions['petsc']}, qsdolfinx {versions['qsdolfinx']}, "
            f"Python {versions['python']}; {result['date']}"
        )
        groups.setdefault(text, []).append(result)
    lines = []
    for text, members in groups.items():
        titles = ", ".join(m["title"] for m in members)
        minutes = sum(m["measured_in_seconds"] for m in members) / 60
        lines.append(f"- {titles}: {text}; measured in {minutes:.0f} minutes.")
    return "\n".join(lines)


def case_section(result, figures, document):
    """Text, figure and table of one case."""
    filename = figures / f"speed_{result['case']}.png"
    plot(result, filename)
    link = pathlib.Path(os.path.relpath(filename, document.parent)).as_posix()
    text = result["text"][0].upper() + result["text"][1:] + "."
    for key, value in result["reference"].items():
        shown = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
        text += f" {key[0].upper()}{key[1:]}: {shown}."
    return (
        f"## {result['title']}\n\n{wrap(text)}\n\n"
        f"![{result['title']}: error over CPU time]({link})\n\n{case_table(result)}\n"
    )


def wrap(text):
    """A paragraph, or an item of a list."""
    indent = " " * (len(text) - len(text.lstrip(" ")) + 2) if text.lstrip().startswith("- ") else ""
    return textwrap.fill(
        text, 110, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )


def report(results, document, figures):
    """Write the document and the figures."""
    figures.mkdir(parents=True, exist_ok=True)
    document.parent.mkdir(parents=True, exist_ok=True)
    usable = [kind for kind, reasons in faults(results).items() if not reasons]
    commands = "\n    ".join(dict.fromkeys(r["command"] for r in results))
    parts = [
        HEAD.format(commands=commands, circumstances=circumstances(results), floor=floor_note()),
        "## What to take\n\n" + "\n".join(map(wrap, words(results))) + "\n",
        "Error and time of some kinds in those of others, on the finest level that both "
        "have (QS: quasi-symmetric):\n\n" + pairs(results) + "\n",
        "Distance of all kinds from the front, with the error on the finest level solved; **bold** "
        "is on the front or within 10 % of it:\n\n" + summary_table(results) + "\n",
    ]
    if usable:
        parts.append(
            "The same among the kinds that are usable in all cases:\n\n"
            + summary_table(results, usable)
            + "\n"
        )
    parts += [case_section(result, figures, document) for result in results]
    document.write_text("\n".join(parts), encoding="utf-8")


def load(folder):
    """Results of all cases that are there, in their order."""
    files = (folder / f"speed_vs_error_{case}.json" for case in ORDER)
    return [json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    docs = HERE.parent / "docs"
    parser.add_argument("--json-dir", type=pathlib.Path, default=HERE / "results")
    parser.add_argument("--document", type=pathlib.Path, default=docs / "speed-vs-error.md")
    parser.add_argument("--figures", type=pathlib.Path, default=docs / "figures")
    a = parser.parse_args()
    results = load(a.json_dir)
    if not results:
        parser.error(f"no speed_vs_error_CASE.json in {a.json_dir}")
    report(results, a.document.resolve(), a.figures.resolve())
    print("\n".join(words(results)))


if __name__ == "__main__":
    main()
