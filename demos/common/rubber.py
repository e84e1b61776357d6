"""Draw the picture of the rubber demo. Collective: data are gathered on rank 0, which draws."""

import numpy as np

import ufl
from dolfinx import fem

from common.drawing import cells, draw_cells, node_values, pyplot, save


class Rubber:
    """The rubber undeformed, pressed and rolled, and the distance of the roller."""

    def __init__(self):
        self.states = {}

    def __call__(self, row, scene):
        """Keep the latest state of pressing and of rolling. Collective."""
        body = scene.body
        stress = ufl.dev(body.stress)
        shear = ufl.sqrt(0.5 * ufl.inner(stress, stress))
        u = fem.Function(fem.functionspace(body.mesh, ("Lagrange", 1, (2,))))
        u.interpolate(body.u)
        shape = cells(body.mesh, node_values(u), shear)
        self.states["pressed" if row.t <= scene.pressing else "rolled"] = (
            row,
            shape,
            scene.lines(),
        )

    def draw(self, filename, rows):
        """Draw both states, and force and distance over time; on rank 0.

        Args:
            filename: Name of the picture file.
            rows: Table rows of all steps.
        """
        if next(iter(self.states.values()))[1] is None:
            return
        figure = pyplot().figure(figsize=(12, 4.4), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.9, 1))
        last = list(self.states.values())[-1]
        largest = np.percentile(last[1][1], 99)
        places = np.concatenate([shape[0].reshape(-1, 2) for _, shape, _ in self.states.values()])
        low, high = places.min(axis=0), places.max(axis=0)
        beside = (high - low)[0] < 4 * (high - low)[1]
        grid = (1, len(self.states)) if beside else (len(self.states), 1)
        axes = left.subplots(*grid, sharex=True, sharey=True, squeeze=False).ravel()
        for axis, (name, (row, shape, lines)) in zip(axes, self.states.items(), strict=True):
            colours = draw_cells(axis, *shape, cmap="viridis", linewidth=0.1)
            colours.set_clim(0, largest)
            for line in lines:
                axis.plot(*line.T, color="black", lw=1.2)
            width, height = high - low
            axis.set(xlim=(low[0] - 0.05 * width, high[0] + 0.05 * width))
            axis.set(ylim=(low[1] - 0.1 * height, high[1] + 0.1 * height))
            moved = round(row.moved, 3) + 0.0  # and without -0
            axis.set(title=f"{name}: force {row.force:.3g}, moved by {moved:g}", aspect="equal")
            axis.set(xlabel="x", ylabel="y")
            axis.label_outer()
        label = "shear stress / shear modulus (-)"
        left.colorbar(colours, ax=list(axes), label=label, extend="max", pad=0.01, shrink=0.8)
        for axis, name, text in zip(
            right.subplots(2, 1, sharex=True),
            ("force", "moved"),
            ("vertical force", "moved along x"),
            strict=True,
        ):
            axis.plot([row.t for row in rows], [getattr(row, name) for row in rows], "o-", ms=2.5)
            axis.set_ylabel(text)
            axis.grid()
        axis.set_xlabel("step")
        save(figure, filename)
