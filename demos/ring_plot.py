"""Picture of ring compressions: deformed sections and calibration curves."""

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

SHOWN = (0.0, 0.15, 0.7)


def draw(results, filename):
    """Draw what ``ring_compression.calibrate`` returns.

    Args:
        results: Result, history and ring of each friction factor.
        filename: File of the picture.
    """
    figure = plt.figure(figsize=(12, 5.6), layout="constrained")
    grid = figure.add_gridspec(len(SHOWN), 2, width_ratios=(1, 1.25))
    first = None
    for i, factor in enumerate(SHOWN):
        first = axis = figure.add_subplot(grid[i, 0], sharex=first)
        _, rows, ring = results[factor]
        x = ring.mesh.geometry.x
        axis.triplot(x[:, 0], x[:, 1], ring.mesh.geometry.dofmap, color="tab:red", lw=0.5)
        axis.plot([0, 24], [0, 0], color="black", lw=2)
        top = x[:, 1].max()
        axis.plot([0, 24], [top, top], color="black", lw=2)
        axis.axvline(0, color="black", lw=0.8, ls="-.")
        for radius in (7.5, 15.0):
            axis.axvline(radius, color="gray", lw=0.8, ls=":")
        title = "no friction" if factor == 0 else f"m\u0304 = {factor:g}"
        axis.set_title(f"{title}, {rows[-1]['reduction']:.0%} reduction", fontsize=10)
        axis.set(aspect="equal", ylabel="z (mm)", xlim=(-0.5, 24))
        axis.tick_params(labelbottom=i == len(SHOWN) - 1)
    first.set_xlabel("r (mm); dotted: radii before")
    axis = figure.add_subplot(grid[:, 1])
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.9, len(results)))
    for colour, (factor, (_, rows, _)) in zip(colours, results.items(), strict=True):
        reduction = np.array([0.0] + [row["reduction"] for row in rows])
        change = np.array([1.0] + [row["inner_radius"] for row in rows]) - 1
        axis.plot(100 * reduction, -100 * change, color=colour, label=f"m\u0304 = {factor:g}")
    s = np.linspace(0, max(reduction), 50)
    axis.plot(100 * s, 100 * (1 - 1 / np.sqrt(1 - s)), "k:", label="closed form, m\u0304 = 0")
    axis.axhline(0, color="gray", lw=0.8)
    axis.set_xlabel("reduction of the height (%)")
    axis.set_ylabel("decrease of the inner diameter (%)")
    axis.set_title("ring 6:3:2, Tresca's friction", fontsize=10)
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(filename, dpi=110)
