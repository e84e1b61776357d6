"""Time the gaps and the derivative of contact with updated geometry, by stage and pair of facets.

A neo-Hookean block is pressed into a larger one and pushed along it, with hexahedra or tetrahedra,
on one rank. At its solution, gaps and the derivative of contact are evaluated again at --repeats
slightly different positions. A row for each friction coefficient: µs of CPU time per evaluation
and pair of intersecting facets, for each stage, without the bodies' own forces and matrices; the
least of the repetitions, as other programs only add time.

    python3 bench/pairs.py --cells 20
    python3 bench/pairs.py --cells 20 --cell tetrahedron --friction 0 0.3
    python3 bench/pairs.py --cells 20 --profile
"""

import argparse
import collections
import cProfile
import functools
import pathlib
import pstats
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))


import numpy as np
from machine import circumstances, write
from sliding import block

import qsdolfinx as qs
from qsdolfinx import _cpp
from qsdolfinx.gap.facet_cutter import FacetCutter
from qsdolfinx.system.body import Body

#: Functions whose time is that of a stage, without the stages inside.
STAGES = {
    "bodies": [(Body, "residual")],
    "segments": [(_cpp, "overlay_pieces")],
    "operator": [(FacetCutter, "operator_at_points")],
    "slip": [(FacetCutter, "slip_at_points")],
    "blocks": [(_cpp, "add_point_forces")],
    "insertion": [(_cpp.RowSums, "insert")],
}
#: Columns: the stages of gaps, all else in them, those of the derivative, all else, and sums.
COLUMNS = (
    *("segments", "operator", "slip", "law", "gap"),
    *("blocks", "insertion", "other", "tangent", "both"),
)


class Clock:
    """CPU time (s) of stages, each without those inside it."""

    def __init__(self):
        self.spent, self._open, self._since = collections.Counter(), [], 0.0

    def time(self, stage, function):
        """Return the function with its time counted for a stage."""

        @functools.wraps(function)
        def timed(*args, **kwargs):
            self._book()
            self._open.append(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self._book()
                self._open.pop()

        return timed

    def _book(self):
        now = time.process_time()
        if self._open:
            self.spent[self._open[-1]] += now - self._since
        self._since = now


def scene(p, mu):
    """Return the problem of two flat blocks, one pressed into the other, and its contact."""
    n = p.cells
    wide = round(1.25 * n)
    lower = block([(0, 0, 0.8), (1.2, 1.2, 1)], (wide, wide, 2), p.cell, 1e3, 0.8, 1)
    upper = block([(0.1, 0.1, 1), (0.9, 0.9, 1.2)], (n, n, 2), p.cell, 5e2, 1.2, 1)
    friction = qs.Coulomb(mu) if mu else None
    contact = qs.Contact(upper[4], lower[4], sliding="finite", friction=friction)
    parts = [list(part) for part in zip(lower, upper, strict=True)]
    problem = qs.ContactProblem(
        parts[0], parts[1], [contact], [[bc] for bc in parts[2]], linear_solver="direct"
    )
    upper[3].value[:] = 0.3 / n, 0.2 / n, -0.004
    return problem, contact


def count_stages(clock):
    """Count the time of the functions of all stages."""
    for stage, places in STAGES.items():
        for owner, name in places:
            setattr(owner, name, clock.time(stage, getattr(owner, name)))


def measure(p, mu, clock):
    """Return the times of one scene as a row."""
    problem, contact = scene(p, mu)
    problem.solve()
    equations, rng = problem.equations(), np.random.default_rng(1)
    z, size = equations.first(), 1e-3 * 0.8 / p.cells
    evaluate = clock.time("law", equations.evaluate)
    derivative = clock.time("other", equations.derivative.beside_bodies)
    profile, rows = cProfile.Profile(), []
    for _ in range(p.repeats):
        clock.spent.clear()
        moved = z.copy()
        bodies = equations.bodies_of(moved)
        bodies += size * rng.uniform(-1, 1, len(bodies))
        if p.profile:
            profile.enable()
        derivative(evaluate(moved))
        profile.disable()
        rows.append(clock.spent.copy())
    if p.profile:
        pstats.Stats(profile).sort_stats("tottime").print_stats(30)
    gap = contact.model.gaps[0]
    pairs = gap.cut.found.of_cutter.size
    row = {name: 1e6 / pairs * min(r[name] for r in rows) for name in COLUMNS}
    row["gap"] = sum(row[name] for name in COLUMNS[:4])
    row["tangent"] = sum(row[name] for name in COLUMNS[5:8])
    row["both"] = row["gap"] + row["tangent"]
    active = float(np.mean(equations.evaluate(z).passes[0].active))
    problem.destroy()
    return {"friction": mu, "pairs": pairs, "points": gap.num_rows, "active": active} | row


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--cells", type=int, default=20, help="cells along an edge of the upper block")
    add("--cell", default="hexahedron", choices=("hexahedron", "tetrahedron"))
    add("--friction", nargs="+", type=float, default=[0.0, 0.3])
    add("--repeats", type=int, default=5)
    add("--profile", action="store_true", help="show the functions with the largest time")
    add("--json", metavar="FILE")
    p = parser.parse_args()
    rows, clock = [], Clock()
    count_stages(clock)
    print(f"{'friction':>9}{'pairs':>7}{'points':>8}{'active':>7}", end="")
    print("".join(f"{name:>10}" for name in COLUMNS))
    for mu in p.friction:
        row = measure(p, mu, clock)
        rows.append(row)
        print(f"{mu:9.2g}{row['pairs']:7}{row['points']:8}{row['active']:7.2f}", end="")
        print("".join(f"{row[name]:10.2f}" for name in COLUMNS), flush=True)
    if p.json:
        write(p.json, circumstances(1) | {"cells": p.cells, "cell": p.cell, "rows": rows})


if __name__ == "__main__":
    main()
