"""Draw the picture of the roller on rubber; data are gathered on rank 0, which draws."""

import numpy as np

import ufl

from common.drawing import cells, draw_cells, node_values, pyplot, save
from rubber_bodies import HEIGHT
from rubber_scenes import ROLLER


def draw(filename, result, rows, scene, published):
    """Draw the rubber under the roller, and its distance over the angle. Collective."""
    body = scene.body
    shear = ufl.sqrt(0.5 * ufl.inner(ufl.dev(body.stress), ufl.dev(body.stress)))
    shape = cells(body.mesh, node_values(body.u), shear)
    if shape is None:
        return
    figure = pyplot().figure(figsize=(12, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
    colours = draw_cells(left, *shape, cmap="viridis", linewidth=0.1)
    rim, spoke = scene.lines()
    left.fill(*rim.T, facecolor="0.88", edgecolor="black")
    left.plot(*spoke.T, color="black", marker="o", markevery=(0, 2))
    x = scene.lid.center[0]
    left.set(xlim=(x - 60, x + 60), ylim=(-HEIGHT, 62), xlabel="x (mm)", ylabel="y (mm)")
    left.set_title(f"turned by {np.degrees(rows[-1]['angle']):.0f}°")
    figure.colorbar(colours, ax=left, label="shear stress / shear modulus (-)", shrink=0.9)
    degrees = np.degrees([row["angle"] for row in rows])
    right.plot(degrees, [row["way"] for row in rows], "o", label="rolled")
    lines = {"R φ": (turn := 2 * np.pi * ROLLER, ":"), "R φ / λ": (turn / result["stretch"], "-")}
    lines["published, 175.4 mm a turn"] = published, "--"
    for name, (turn, style) in lines.items():
        right.plot(degrees, turn * degrees / 360, style, color="black", label=name)
    right.set(xlabel="angle (°)", ylabel="way to the left (mm)")
    right.grid()
    right.legend()
    save(figure, filename)
