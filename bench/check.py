"""Check for loss of speed: compare ratios measured in one run with recorded ratios.

Every figure is a ratio of two measurements of this run, or a count, so that the machine matters
little: contact against one body without contact (processor seconds, memory, Krylov iterations, both
to the same residual; bench/scaling.py), contact detection against SciPy's k-d tree
(bench/pairing.py), overlay against nodal quadrature, a Newton iteration of flow against an elastic
problem (bench/flow.py), contact with an unknown active set against a tie (bench/active_set.py). The
fastest repeat counts. Ends with 1 if a figure is more than 25 % worse than recorded.

    make bench-check
    python3 bench/check.py --record
"""

import argparse
import json
import pathlib
import sys
import types

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances
from scaling import CONTACT, start

RECORD = pathlib.Path(__file__).resolve().parent / "results" / "ratios.json"
#: Ratio to the recorded figure from which on a figure counts as worse.
ALLOWED = 1.25
CELLS = 20


def scene(quadrature, enforcement):
    """Options of bench/scaling.py."""
    return types.SimpleNamespace(
        cell="hexahedron",
        quadrature=quadrature,
        enforcement=enforcement,
        partition="graph",
        no_fixed=True,
    )


OVERLAY = scene("overlay", "penalty")
SCENES = {
    "bonded": ("bonded", OVERLAY),
    "tied": ("tied", OVERLAY),
    "unilateral": ("unilateral", OVERLAY),
    "unilateral, augmented": ("unilateral", scene("overlay", "augmented-lagrangian")),
    "unilateral, nodal": ("unilateral", scene("nodal", "penalty")),
}


def ratios_of_solving(repeats):
    """Measure contact against a bonded body of as many unknowns, on one rank; each at its fastest.

    The scenes alternate, so that a busy minute of the machine affects all of them.
    """
    runs = [
        {name: start(model, CELLS, 1, options) for name, (model, options) in SCENES.items()}
        for _ in range(repeats)
    ]
    rows = {name: min((run[name] for run in runs), key=lambda r: r["processor"]) for name in SCENES}
    bonded, out = rows.pop("bonded"), {}
    for name, row in rows.items():
        out[f"{name}: seconds over bonded"] = row["processor"] / bonded["processor"]
        out[f"{name}: memory over bonded"] = row["MiB"] / bonded["MiB"]
        out[f"{name}: Krylov iterations over bonded"] = row["iterations"] / bonded["iterations"]
        contact = sum(row["stages"][stage] for stage in CONTACT)
        out[f"{name}: contact over bulk assembly"] = contact / row["stages"]["bulk assembly"]
    return out


def ratios_of_pairing():
    """Measure contact detection against SciPy's search for the nearest vertex."""
    from pairing import measure

    out = {}
    for facet in ("triangle", "quadrilateral"):
        row = measure(facet, 100, 3, 0)
        tree = sum(row["k-d tree"].values())
        for step in ("update", "pairing"):
            out[f"{step}, {facet}: time over k-d tree"] = row["qsdolfinx"][step] / tree
    return out


def ratios_of_flow():
    """Measure a Newton iteration of the forging demo against a whole elastic contact problem."""
    import flow

    options = types.SimpleNamespace(m=0.15, enforcement="penalty", solver="schur", steps=2, ranks=1)
    row = flow.start(options, 8)
    return {
        "flow: Newton iteration over elastic contact": row["ratio"],
        "flow: Krylov iterations of a Newton iteration": row["krylov"],
    }


def ratios_of_active_sets():
    """Measure unilateral Hertz contact against a tie of the same meshes."""
    from active_set import rows_of

    out = {}
    for enforcement in ("penalty", "augmented-lagrangian"):
        options = types.SimpleNamespace(
            enforcement=enforcement, constraints="nodes", solver="amg", repeats=1
        )
        row = next(r for r in rows_of((20, 16), options) if r["law"] == "unilateral")
        out[f"Hertz, {enforcement}: seconds over tied"] = row["ratio"]
    return out


def least(runs):
    """Measure each figure."""
    return {name: min(run[name] for run in runs) for name in runs[0]}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--record", action="store_true", help="record the measured figures")
    parser.add_argument("--repeats", type=int, default=3)
    p = parser.parse_args()
    figures = ratios_of_solving(p.repeats)
    figures |= least([ratios_of_pairing() for _ in range(p.repeats)])
    figures |= least([ratios_of_flow() for _ in range(p.repeats)])
    figures |= least([ratios_of_active_sets() for _ in range(p.repeats)])
    if p.record:
        RECORD.write_text(json.dumps(circumstances(1) | {"ratios": figures}, indent=1) + "\n")
    recorded = json.loads(RECORD.read_text())["ratios"]
    worse = 0
    print(f"{'':55}{'recorded':>10}{'now':>10}")
    for name, value in figures.items():
        before = recorded.get(name)
        bad = before is not None and value > ALLOWED * before
        worse += bad
        was = f"{before:10.3f}" if before is not None else f"{'-':>10}"
        print(f"{name:55}{was}{value:10.3f}{'  worse' if bad else ''}")
    print(f"{worse} of {len(figures)} figures are more than {ALLOWED - 1:.0%} worse")
    sys.exit(worse > 0)


if __name__ == "__main__":
    main()
