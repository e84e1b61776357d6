"""Draw the picture of the bridge bearing; data are gathered on rank 0, which draws."""

import numpy as np

from common.drawing import boundary, draw_triangles, gather, node_values, pyplot, save, set_view

COLOURS = {"pier": (0.75, 0.74, 0.7, 1), "pad": (0.95, 0.95, 0.85, 1), "plate": (0.5, 0.6, 0.75, 1)}


class Picture:
    """Draws the blocks in their final state, and forces over time."""

    def __init__(self):
        self.skins = {}

    def __call__(self, t, bodies):
        """Keep the surfaces of the blocks. Collective."""
        for name, body in bodies.items():
            x = body.mesh.geometry.x
            nodes, _ = boundary(body.mesh, x)
            self.skins[name] = gather(body.mesh.comm, (x + node_values(body.u))[nodes])

    def draw(self, filename, rows, again):
        """Draw the blocks and the forces; on rank 0."""
        if self.skins["pad"] is None:
            return
        figure = pyplot().figure(figsize=(12, 4.8), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.2, 1))
        axis = left.add_subplot(projection="3d")
        set_view(axis, 14, -62, ((-40, 260), (0, 200), (-100, 60)), zoom=0.95)
        axis.set_axis_on()
        axis.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", title="at the end")
        axis.set(xticks=(0, 100, 200), yticks=(0, 100, 200), zticks=(-50, 0, 50))
        for name, (triangles,) in self.skins.items():
            draw_triangles(axis, triangles, np.tile(COLOURS[name], (len(triangles), 1)))
        axes = right.subplots(2, 1, sharex=True)
        for axis, key, text in zip(axes, "zx", ("load (kN)", "drag (kN)"), strict=True):
            for of_run, style, label in ((rows, "o-", "one run"), (again, "rx", "went on")):
                values = np.abs([row[f"plate_{key}"] for row in of_run]) / 1e3
                axis.plot([row["t"] for row in of_run], values, style, label=label, ms=5)
            axis.set(ylabel=text, ylim=(0, None))
            axis.axvline(2.0, color="black", ls=":", label="checkpoint")
            axis.grid()
        axes[1].set(xlabel="time: pressed until 1, then moved along x (-)", xlim=(0, None))
        axes[1].legend(loc="center left")
        save(figure, filename)
