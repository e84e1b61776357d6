"""Compare small and finite sliding in ironing, for steps of a fraction of a facet to several.

The demo's indenter (demos/ironing.py, friction 0.3, penalty) is dragged over --facets facets of the
slab. Printed for each kind of sliding and each displacement per step: number of steps, Newton
iterations in all and per step of the slide, seconds, mean and oscillation of the tangential force
(largest less smallest over mean).

    python3 bench/ironing_steps.py --plot ironing_sliding.png
"""

import argparse
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "demos"))

import ironing
import numpy as np
from machine import circumstances, write

#: Facets per step of the slide, by kind of sliding.
WAYS = {"small": (0.14, 0.25, 0.45), "finite": (0.14, 0.5, 1.0, 3.0, 6.0)}


def run(sliding, way, facets):
    """Return one ironing run as a row, and the force over the slide in its plateau."""
    steps = ironing.PRESSING + round((facets + ironing.RUN_IN) / way)
    p = ironing.Parameters(sliding=sliding, steps=steps, facets=facets)
    start, iterations = time.perf_counter(), []

    def note(row, scene):
        iterations.append(scene[-1].num_iterations)

    result, rows, _ = ironing.run(p, on_step=note)
    seconds = time.perf_counter() - start
    slide, _ = ironing.on_plateau(p, rows)
    return {
        "sliding": sliding,
        "facets_per_step": facets / p.plan()[1],
        "steps": result["steps"],
        "newton": sum(iterations),
        "newton_per_step": sum(iterations[-p.plan()[1] :]) / p.plan()[1],
        "seconds": seconds,
        "mean": float(np.mean(slide.fx)),
        "oscillation": result["force_oscillation"],
        "slide": [float(x) for x in slide.slide],
        "fx": [float(x) for x in slide.fx],
    }


def plot(rows, filename):
    """Draw the tangential force over the slide, one panel for each kind of sliding."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), sharey=True, layout="constrained")
    for axis, sliding in zip(axes, WAYS, strict=True):
        for row in rows:
            if row["sliding"] == sliding:
                label = f"{row['facets_per_step']:.2g} facets a step, {row['newton']} iterations"
                axis.plot(row["slide"], row["fx"], ".-", lw=1, ms=4, label=label)
        axis.set(title=f'sliding="{sliding}"', xlabel="slide / facet of the slab")
        axis.legend(fontsize=8)
    axes[0].set_ylabel("force along / (E × height)")
    figure.savefig(filename, dpi=150)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=24)
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--plot", metavar="FILE")
    p = parser.parse_args()
    print("sliding   facets a step  steps  newton  a step  seconds      mean  oscillation")
    rows = []
    for sliding, ways in WAYS.items():
        for way in ways:
            row = run(sliding, way, p.facets)
            rows.append(row)
            print(
                f"{sliding:8}{row['facets_per_step']:15.2f}{row['steps']:7}"
                f"{row['newton']:8}{row['newton_per_step']:8.1f}{row['seconds']:9.1f}"
                f"{row['mean']:10.6f}{row['oscillation']:13.1e}",
                flush=True,
            )
    if p.json:
        write(p.json, circumstances(1) | {"rows": rows})
    if p.plot:
        plot(rows, p.plot)


if __name__ == "__main__":
    main()
