"""Compare the pressure of conforming surfaces for flat facets and meshes of degree 2.

A shrink fit, and rings with the contact pressure p + q cos 2θ, in 2D, with each side as the slave
and each mesh inside. Prints the table of docs/method.md.

    python3 bench/curved_facets.py
"""

import pathlib
import sys
import warnings

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests"))

from curved_scenes import LoadedRings, ShrinkFit, exact_pressure
from scenes import WORLD

KINDS = {
    "facets as they are": [{"degrees": (1, d)} for d in (1, 2)],
    "mesh of degree 2": [{"degrees": (2, d)} for d in (1, 2)],
    "mesh of degree 2 by `qs.elevate`": [{"degrees": ("elevated", d)} for d in (1, 2)],
    "the same, with `shape=`": [{"degrees": ("named", d)} for d in (1, 2)],
    'by `qs.elevate`, `sliding="finite"`': [
        {"degrees": ("elevated", d), "sliding": "finite"} for d in (1, 2)
    ],
}


def solved(scene, n, options):
    """Run all combinations."""
    for meshes in (n, n[::-1]):
        for swap in (False, True):
            made = scene(meshes, swap, enforcement="augmented-lagrangian", **options)
            made.problem().solve()
            yield made


def shrink_fit(scene, side):
    mean, scatter = scene.pressure(side)
    return np.hypot(mean / exact_pressure() - 1, scatter / exact_pressure())


def main():
    warnings.simplefilter("ignore")
    sides = "slave", "master"
    lines = ["| | shrink fit, P1 | P2 | p + q cos 2θ, P1 | P2 |", "|---|---|---|---|---|"]
    for name, kinds in KINDS.items():
        fits = [
            max(shrink_fit(scene, side) for scene in solved(ShrinkFit, n, kind) for side in sides)
            for n in [((16, 5), (22, 7))]
            for kind in kinds
        ]
        rings = [
            max(scene.error(side) for scene in solved(LoadedRings, n, kind) for side in sides)
            for n in [((31, 10), (52, 17))]
            for kind in kinds
        ]
        errors = " | ".join(f"{100 * error:.2f}" for error in (*fits, *rings))
        lines.append(f"| {name} | {errors} |")
    if WORLD.rank == 0:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
