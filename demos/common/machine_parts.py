"""Draw the pictures of an O-ring, a press fit, a ball in a socket and a pair of gears.

All functions are collective: the data are gathered on rank 0, which draws the picture.
"""

import numpy as np

import ufl

from common.drawing import cells, draw_cells, node_values, pyplot, save

FOURFOLD = ([1, 1], [-1, 1], [1, -1], [-1, -1])


def oring(filename, rings, forces, height, half_width):
    """Draw the pressure in squeezed rings, each in its groove.

    Args:
        filename: Name of the picture file.
        rings: Quarters of the rings, by name.
        forces: Force over the force of the formula, by name.
        height: Half the height of the groove.
        half_width: Half the width of the groove.
    """
    parts = {
        name: cells(ring.mesh, node_values(ring.u), -ufl.tr(ring.stress) / 2)
        for name, ring in rings.items()
    }
    if None in parts.values():
        return
    figure = pyplot().figure(figsize=(11, 3.1), layout="constrained")
    axes = figure.subplots(1, len(parts), sharey=True)
    y, x = height, half_width
    for axis, (name, (corners, values)) in zip(axes, parts.items(), strict=True):
        for side in FOURFOLD:
            colours = draw_cells(axis, corners * side, values, cmap="viridis", linewidth=0.15)
            colours.set_clim(-0.5, 2.0)
        axis.fill([-2, -2, 2, 2, x, x, -x, -x], [y, -1.2, -1.2, y, y, -y, -y, y], "0.8")
        axis.fill([-2, -2, 2, 2], [y, 1.2, 1.2, y], "0.6")
        axis.set_title(f"{name}: force / Lindley's {forces[name]:.3f}")
        axis.set(xlim=(-2, 2), ylim=(-1.2, 1.2), xlabel="x / radius (-)")
    axes[0].set_ylabel("y / radius (-)")
    label = "pressure / shear modulus (-)"
    figure.colorbar(colours, ax=list(axes), label=label, extend="both", pad=0.01)
    save(figure, filename)


def press_fit(filename, bodies, rows, length, forces):
    """Draw a section of a shaft that is pulled out of its hub, and the pull-out force.

    Args:
        filename: Name of the picture file.
        bodies: Hub and shaft, each with its radial stress (MPa).
        rows: Displacements (mm) of the shaft and pulls (N), an array.
        length: Length of the fit (mm).
        forces: Initial pull-out forces (N): closed form, and closed form without the loss of
            pressure.
    """
    parts = [cells(b.mesh, node_values(b.u), b.stress[0, 0]) for b in bodies]
    if parts[0] is None:
        return
    figure = pyplot().figure(figsize=(11, 4.4), layout="constrained")
    left, *right = figure.subplots(1, 3, width_ratios=(1.7, 0.7, 0.9))
    for corners, values in parts:
        for side in ([1, 1], [-1, 1]):
            colours = draw_cells(left, corners * side, values, cmap="viridis", linewidth=0.15)
            colours.set_clim(-110, 10)
    way, pull = rows
    for side in (-1, 1):
        left.fill_betweenx([length, length + 3], 23 * side, 40 * side, color="0.6")
        left.text(31.5 * side, length + 4.5, "plate", ha="center")
    tip = length + way[-1]
    left.annotate("", (0, tip + 9), (0, tip), arrowprops={"arrowstyle": "-|>", "lw": 2.5})
    left.set(xlabel="r (mm)", ylabel="z (mm)", xlim=(-46, 46), ylim=(-4, tip + 12))
    left.set_title(f"shaft pulled out of its hub by {way[-1]:.0f} mm")
    figure.colorbar(colours, ax=left, label="radial stress (MPa)", extend="both", shrink=0.9)
    exact, simple = forces
    for axis, unit, scale, largest in zip(right, ("µm", "mm"), (1e3, 1), (20, 10), strict=True):
        s = np.linspace(0, largest, 50)
        axis.plot(scale * way, pull / 1e3, "o-", label="computed")
        axis.plot(s, (1 - s / scale / length) * simple / 1e3, "--k", label="2π a (L − s) μ p₀")
        axis.plot(0, exact / 1e3, "D", color="C3", ms=8, clip_on=False, label="closed form")
        axis.set(xlim=(0, largest), ylim=(0, 52), xlabel=f"way s of the shaft's end ({unit})")
        axis.grid()
    right[0].set(ylabel="pull (kN)", title="until it slips")
    right[1].set(title="sliding")
    right[1].legend(loc="lower left")
    save(figure, filename)


def ball_in_socket(filename, drawn, sizes, radius, p0):
    """Draw ball and socket, and the pressure between them on fine and coarse facets.

    Args:
        filename: Name of the picture file.
        drawn: For each way of solving: the bodies, and radii (mm) and pressures (MPa) of the nodes
            of the ball; names on coarse facets begin with "coarse_".
        sizes: Sizes of the fine and the coarse facets (mm).
        radius: Contact radius of Hertz' theory (mm).
        p0: Largest pressure by Hertz' theory (MPa).
    """
    bodies, _ = drawn["curved_p2"]
    parts = [cells(b.mesh, node_values(b.u), b.stress[1, 1]) for b in bodies]
    if parts[0] is None:
        return
    figure = pyplot().figure(figsize=(12, 4.2), layout="constrained")
    left, *right = figure.subplots(1, 3, width_ratios=(1.45, 1, 1))
    for corners, values in parts:
        for side in ([1, 1], [-1, 1]):
            colours = draw_cells(left, corners * side, values, cmap="viridis", linewidth=0.1)
            colours.set_clim(-100, 0)
    for x in np.linspace(-8, 8, 5):
        left.annotate("", (x, 10.1), (x, 13.4), arrowprops={"arrowstyle": "-|>"})
    left.set(xlabel="r (mm)", ylabel="z (mm)", xlim=(-21, 21), ylim=(-11, 14))
    left.set_title("half ball in a socket that is 0.1 mm wider")
    figure.colorbar(colours, ax=left, label="axial stress (MPa)", extend="both", shrink=0.85)
    r = np.linspace(0, radius, 200)
    for axis, prefix, h, end in zip(right, ("", "coarse_"), sizes, (3, 6), strict=True):
        axis.plot(r, p0 * np.sqrt(1 - (r / radius) ** 2), "k", lw=2, alpha=0.4, label="Hertz")
        for way, style in (("facets", "s-C3"), ("curvature", "^-C1"), ("curved_p2", "o-C0")):
            axis.plot(*drawn[prefix + way][1].T, style, ms=4, lw=1, label=way)
        axis.set(xlim=(0, end), ylim=(0, 1.6 * p0), xlabel="r (mm)")
        axis.set_title(f"facets of {h:g} mm")
        axis.grid()
    right[0].set_ylabel("pressure on the ball (MPa)")
    right[0].legend()
    save(figure, filename)


def gear_pair(filename, positions, torques, gears):
    """Draw the equivalent stress in two gears and near their contact, and torques over a pitch.

    Args:
        filename: Name of the picture file.
        positions: Positions, in pitches from the pitch point.
        torques: Torques on pinion and wheel (N mm per mm), a row for each position.
        gears: Pinion and wheel in the position to be drawn.
    """
    parts = []
    for gear in gears:
        s = gear.stress  # plane strain: σ_z = ν (σ_x + σ_y)
        squares = s[0, 0] ** 2 + s[1, 1] ** 2 - s[0, 0] * s[1, 1] + 3 * s[0, 1] ** 2
        mean = 0.3 * ufl.tr(s)
        parts.append(
            cells(gear.mesh, node_values(gear.u), ufl.sqrt(squares + mean**2 - mean * ufl.tr(s)))
        )
    if parts[0] is None:
        return
    figure = pyplot().figure(figsize=(12, 4.6), layout="constrained")
    both, near, right = figure.subfigures(1, 3, width_ratios=(1.35, 1, 1))
    place = gears[0].profile.radius
    for part, window, title in (
        (both, ((19, 71), (-26, 26)), "pinion and wheel"),
        (near, ((place - 0.8, place + 0.8), (-0.8, 0.8)), "at the pitch point"),
    ):
        axis = part.subplots()
        for corners, values in parts:
            colours = draw_cells(axis, corners, values, cmap="viridis", linewidth=0.05)
            colours.set_clim(0, 800)
        axis.set(xlim=window[0], ylim=window[1], xlabel="x (mm)", ylabel="y (mm)", title=title)
    both.colorbar(colours, ax=both.axes, label="equivalent stress (MPa)", extend="max", shrink=0.8)
    pinion, wheel = torques.T
    axes = right.subplots(2, 1, sharex=True)
    axes[0].plot(positions, pinion / 1e3, "o-")
    axes[0].set(ylabel="on the pinion (N m / mm)", title="torque", ylim=(0, None))
    axes[1].plot(positions, 100 * (wheel / pinion / 2 - 1), "o-")
    axes[1].set(ylabel="error of the ratio (%)", xlabel="turn of the pinion (pitches)")
    axes[1].set(ylim=(-0.6, 0.6))
    for axis in axes:
        axis.grid()
    save(figure, filename)
