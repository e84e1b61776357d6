"""Picture of ring compressions: deformed sections and calibration curves."""

import numpy as np
from plotting import cells, draw_cells, pyplot, save

SHOWN = (0.0, 0.15, 0.7)


def draw(results, filename):
    """Draw what ``ring_compression.calibrate`` returns. Collective.

    Args:
        results: Result, history and ring of each friction factor.
        filename: File of the picture.
    """
    sections = {factor: cells(results[factor][2].mesh) for factor in SHOWN}
    if sections[SHOWN[0]] is None:  # not on rank 0
        return
    figure = pyplot().figure(figsize=(12, 5.6), layout="constrained")
    grid = figure.add_gridspec(len(SHOWN), 2, width_ratios=(1, 1.25))
    first = None
    for i, (factor, (corners, _)) in enumerate(sections.items()):
        first = axis = figure.add_subplot(grid[i, 0], sharex=first)
        draw_section(axis, corners)
        title = "no friction" if factor == 0 else f"m\u0304 = {factor:g}"
        axis.set_title(f"{title}, {results[factor][1][-1]['reduction']:.0%} reduction")
        axis.tick_params(labelbottom=i == len(SHOWN) - 1)
    first.set_xlabel("r (mm); dotted: radii before")
    draw_curves(figure.add_subplot(grid[:, 1]), results)
    save(figure, filename)


def draw_section(axis, corners):
    """A deformed ring between the dies."""
    draw_cells(axis, corners, facecolor="none", edgecolor="tab:red", linewidth=0.5)
    for z in (0, corners[..., 1].max()):
        axis.plot([0, 24], [z, z], color="black", lw=2)
    axis.axvline(0, color="black", lw=0.8, ls="-.")
    for radius in (7.5, 15.0):
        axis.axvline(radius, color="gray", lw=0.8, ls=":")
    axis.set(ylabel="z (mm)", xlim=(-0.5, 24))


def draw_curves(axis, results):
    """Inner diameter over reduction."""
    colours = pyplot().get_cmap("viridis")(np.linspace(0, 0.9, len(results)))
    for colour, (factor, (_, rows, _)) in zip(colours, results.items(), strict=True):
        reduction = np.array([0.0] + [row["reduction"] for row in rows])
        change = np.array([1.0] + [row["inner_radius"] for row in rows]) - 1
        axis.plot(100 * reduction, -100 * change, color=colour, label=f"m\u0304 = {factor:g}")
    s = np.linspace(0, max(reduction), 50)
    axis.plot(100 * s, 100 * (1 - 1 / np.sqrt(1 - s)), "k:", label="closed form, m\u0304 = 0")
    axis.axhline(0, color="gray", lw=0.8)
    axis.set_xlabel("reduction of the height (%)")
    axis.set_ylabel("decrease of the inner diameter (%)")
    axis.set_title("ring 6:3:2, Tresca's friction")
    axis.grid()
    axis.legend()
