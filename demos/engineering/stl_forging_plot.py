"""Draw the picture of the forging with an STL die; data are gathered on rank 0, which draws."""

import numpy as np

from common.drawing import boundary, cell_values, draw_cells, gather, pyplot, save


class Picture:
    """Collects sections of billet and die, and the force, of each step."""

    def __init__(self):
        self.states = []

    def __call__(self, row, billet, profile, height):
        """Keep the section at y = 0. Collective."""
        x, rate = billet.mesh.geometry.x, cell_values(billet.mesh, billet.rate)
        nodes, behind = boundary(billet.mesh, x)
        cut = np.all(np.abs(x[nodes, 1]) < 1e-9, axis=1)
        found = gather(billet.mesh.comm, x[nodes[cut]][:, :, [0, 2]], rate[behind[cut]])
        r = np.linspace(-18, 18, 400)
        die = np.stack([r, height - row["stroke"] + profile(np.abs(r))])
        self.states.append((row, found, die))

    def draw(self, filename, rows):
        """Draw three of the sections, and the force over the stroke; on rank 0."""
        if self.states[0][1] is None:
            return
        figure = pyplot().figure(figsize=(10, 6.4), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1, 1.1))
        shown = [self.states[i] for i in (0, len(rows) // 2, -1)]
        axes = left.subplots(3, 1, sharex=True, sharey=True)
        largest = np.percentile(shown[-1][1][1], 98)
        for axis, (row, (corners, rate), die) in zip(axes, shown, strict=True):
            both = np.concatenate([corners, corners * [-1, 1]])
            colours = draw_cells(axis, both, np.tile(rate, 2), cmap="inferno", linewidth=0.2)
            colours.set_clim(0, largest)
            axis.fill_between(*die, 20, facecolor="0.8", edgecolor="black")
            axis.fill_between([-18, 18], -3, 0, facecolor="0.8", edgecolor="black")
            axis.set(xlim=(-18, 18), ylim=(-3, 18), ylabel="z (mm)")
            axis.set_title(f"stroke {row['stroke']:.2f} mm, boss {row['boss']:.2f} mm")
        axis.set_xlabel("x (mm)")
        left.colorbar(colours, ax=axes, label="strain rate (1/s)", extend="max", shrink=0.7)
        axis = right.subplots()
        axis.plot([row["stroke"] for row in rows], [row["force"] for row in rows], "o-")
        axis.set(xlabel="stroke (mm)", ylabel="force of the press (kN)")
        axis.set(xlim=(0, None), ylim=(0, None))
        axis.grid()
        save(figure, filename)
