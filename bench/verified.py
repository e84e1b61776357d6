"""Compare results with references for the same problem: closed forms, benchmarks, other codes.

Each case is a file of ``verified_cases`` with a docstring that describes the problem and the source
of its references, with ``TITLE``, with ``run(small, comm)``, which solves the case and returns
rows, and with ``FAR``, the largest relative difference of a small run from the references, which
the tests check. References are from other sources, never the limit of our own meshes; deviations
are shown as they are.

    python3 bench/verified.py                        # all cases
    python3 bench/verified.py --case cylinder_roller --json FILE
    python3 bench/verified.py --small                # coarse, as in the tests
    mpirun -n 2 python3 bench/verified.py --markdown docs/verified.md

A row has the quantity, the reference, the scatter of its sources (or its tolerance), our value, and
the difference. ``--markdown`` writes the table into a page, between its two markers. Keys of the
JSON object are "case: quantity", each with reference, scatter, source, ours, difference.
"""

import argparse
import importlib
import json
import pathlib
import sys
import time

from mpi4py import MPI

here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here), str(here.parent / "demos")]

BEGIN, END = "<!-- begin: bench/verified.py -->", "<!-- end: bench/verified.py -->"
HEADER = """| quantity | reference | its scatter | ours | difference |
|---|---|---|---|---|
"""


def names():
    """Return the names of all cases."""
    files = sorted((here / "verified_cases").glob("*.py"))
    return [path.stem for path in files if "\ndef run(" in path.read_text(encoding="utf-8")]


def case(name):
    """Import and return the module of a case."""
    return importlib.import_module(f"verified_cases.{name}")


def number(value):
    """Format a number with five digits."""
    return f"{value:.5g}"


def lines(rows):
    """Yield the lines of a table in Markdown."""
    for row in rows:
        scatter = f"{100 * row.scatter:.2g} %"
        yield (
            f"| {row.quantity} | {number(row.reference)} ({row.source}) | "
            f"{scatter if row.scatter else '-'} | {number(row.ours)} | "
            f"{100 * row.difference:+.2f} % |\n"
        )


def section(name, rows, seconds):
    """Return a case in Markdown: its title, its description and its table."""
    module = case(name)
    said = module.__doc__.strip()
    return (
        f"## {module.TITLE}\n\n{said}\n\n{HEADER}{''.join(lines(rows))}\n"
        f"`python3 bench/verified.py --case {name}`, {seconds:.0f} s.\n"
    )


def write_between(filename, text):
    """Put text between the markers of a page."""
    page = pathlib.Path(filename).read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    page = f"{before}{BEGIN}\n\n{text}\n{END}{after}"
    pathlib.Path(filename).write_text(page, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", choices=names(), help="by default all")
    parser.add_argument("--small", action="store_true", help="coarse: a few seconds each")
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--markdown", metavar="FILE", help="page to write all cases into")
    options = parser.parse_args()
    comm, result, sections = MPI.COMM_WORLD, {}, []
    for name in options.case or names():
        begin = time.perf_counter()
        rows = case(name).run(options.small, comm)
        sections.append(section(name, rows, time.perf_counter() - begin))
        for row in rows:
            result[f"{name}: {row.quantity}"] = {
                "reference": row.reference,
                "scatter": row.scatter,
                "source": row.source,
                "ours": row.ours,
                "difference": row.difference,
            }
        if comm.rank == 0:
            print(f"{case(name).TITLE}\n{''.join(lines(rows))}", flush=True)
    if comm.rank == 0 and options.json:
        pathlib.Path(options.json).write_text(json.dumps(result, indent=1) + "\n")
    if comm.rank == 0 and options.markdown:
        write_between(options.markdown, "\n".join(sections))


if __name__ == "__main__":
    main()
