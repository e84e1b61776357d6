"""The picture of demos/upset_cylinder.py."""

import numpy as np
from plotting import (
    boundary,
    cells,
    draw_cells,
    draw_triangles,
    gather,
    pyplot,
    save,
    set_view,
)

STEEL = (0.95, 0.55, 0.35, 1.0)


class Recorder:
    """Keeps the forces, and the billet at first and at the end, gathered for the picture alone."""

    def __init__(self):
        self.forces, self.first, self.last = [], None, None

    def __call__(self, billet, *force):
        """Take over a state; collective."""
        msh = billet.mesh
        if msh.geometry.dim == 2:
            shape = cells(msh)
        else:
            x = msh.geometry.x
            shape = gather(msh.comm, x[boundary(msh, x)[0]])
        self.last = shape and shape[0]
        if force:
            self.forces.append(force)
        else:
            self.first = self.last

    def plot(self, filename):
        """Billet, force and its error; on rank 0."""
        figure = pyplot().figure(figsize=(12, 4.2), layout="constrained")
        grid = figure.add_gridspec(2, 3, width_ratios=(0.9, 0.9, 1.5), height_ratios=(1.6, 1))
        shapes = ((self.first, "before"), (self.last, "at the end"))
        for i, (shape, title) in enumerate(shapes):
            if shape.shape[-1] == 2:
                axis = figure.add_subplot(grid[:, i])
                draw_cells(axis, shape, facecolor=STEEL)
                axis.set(xlabel="r (-)", ylabel="z (-)" if i == 0 else None)
                axis.set(xlim=(0, 1.05 * self.last[..., 0].max()))
                axis.set(ylim=(-0.5, 1.05 * self.first[..., 1].max()))
            else:
                axis = figure.add_subplot(grid[:, i], projection="3d")
                reach, height = self.last[..., 0].max(), self.first[..., 2].max()
                set_view(axis, 20, 35, ((0, reach), (0, reach), (0, height)))
                draw_triangles(axis, shape, np.tile(STEEL, (len(shape), 1)))
            axis.set_title(title)
        self.draw_forces(figure.add_subplot(grid[0, 2]), figure.add_subplot(grid[1, 2]))
        save(figure, filename)

    def draw_forces(self, above, below):
        """Force beside the closed form, and the deviation."""
        reduction, force, exact = np.array(self.forces).T
        above.plot(100 * reduction, exact / exact[0], color="black", label="closed form")
        above.plot(100 * reduction, force / exact[0], "o", color="tab:orange", label="upper die")
        above.set(ylabel="force / first (-)")
        above.tick_params(labelbottom=False)
        above.legend()
        error = np.maximum(np.abs(force / exact - 1), 1e-16)
        below.semilogy(100 * reduction, error, ".-")
        decades = np.floor(np.log10(error.min())), np.ceil(np.log10(error.max()))
        below.set_ylim(*10.0 ** np.array(decades))
        below.set(xlabel="reduction of the height (%)", ylabel="rel. error (-)")
        for axis in (above, below):
            axis.set_xlim(0, None)
            axis.grid()
