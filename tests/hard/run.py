"""Hard cases for Newton's method, pairing and balance, with every way to enforce contact.

Each case ends with the right answer, or is refused with a message and the state before; the table
says which, for every formulation, quadrature and enforcement. Cases are in the files beside.

    python3 tests/hard/run.py                              # all, a line each
    python3 tests/hard/run.py --cases stiffness edges      # some
    python3 tests/hard/run.py --markdown docs/hard-cases.md --json hard.json
"""

import argparse
import importlib
import json
import pathlib
import sys

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from hard.scenes import VARIANTS, Variant
from hard.table import Row, run, write

#: Of the part of the Markdown file that is written; what is above it stays.
HEADING = "## Results\n"

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


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", choices=GROUPS, default=GROUPS, metavar="NAME")
    parser.add_argument("--only", nargs=3, metavar=Variant._fields, help="one variant")
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--markdown", metavar="FILE")
    a = parser.parse_args()
    rows: list[Row] = []
    for group in a.cases:
        module = importlib.import_module(f"hard.{group}")
        for variant in [Variant(*a.only)] if a.only else VARIANTS:
            for check in module.checks(variant):
                rows.append(run(check, variant))
                if MPI.COMM_WORLD.rank == 0:
                    print(rows[-1].line(), flush=True)
    if MPI.COMM_WORLD.rank > 0:
        return
    count = {status: sum(row.status == status for row in rows) for status in Row.STATUSES}
    print(", ".join(f"{n} {status}" for status, n in count.items()))
    if a.json:
        text = json.dumps([row.as_dict() for row in rows], indent=1, ensure_ascii=False)
        pathlib.Path(a.json).write_text(text + "\n")
    if a.markdown:
        path = pathlib.Path(a.markdown)
        words = path.read_text().partition(HEADING)[0] if path.exists() else ""
        path.write_text(words + HEADING + write(rows))


if __name__ == "__main__":
    main()
