"""Draw the picture of the demo of curved beams."""

import numpy as np

from common.drawing import cells, draw_cells, node_values, pyplot, save


class Beams:
    """Collect the beams of the first mesh at some shifts, and the forces of all meshes.

    Args:
        shifts: Shifts at which the beams are kept.
    """

    def __init__(self, shifts):
        self.shifts = shifts
        self.mesh, self.states = None, []

    def __call__(self, row, scene):
        """Keep the present beams, if they are to be drawn. Collective."""
        beams = scene[:2]
        self.mesh = self.mesh or beams[0].mesh
        if beams[0].mesh is self.mesh and row.shift in self.shifts:
            shapes = [cells(b.mesh, node_values(b.u), b.fibre_stress()) for b in beams]
            self.states.append((row, shapes))

    def draw(self, filename, lines):
        """Draw the beams, and the forces over the shifts; on rank 0.

        Args:
            filename: Name of the picture file.
            lines: Table rows of each mesh, by the name of the mesh.
        """
        if self.states[0][1][0] is None:
            return
        figure = pyplot().figure(figsize=(12, 6.2), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.7, 1))
        axes = left.subplots(-(-len(self.states) // 2), 2, sharex=True, sharey=True)
        stresses = [values for _, shapes in self.states for _, values in shapes]
        largest = np.percentile(np.abs(np.concatenate(stresses)), 99)
        for axis, (row, shapes) in zip(axes.flat, self.states, strict=False):
            for shape in shapes:
                colours = draw_cells(axis, *shape, cmap="RdBu_r", linewidth=0.1)
                colours.set_clim(-largest, largest)
            axis.set_title(f"shift {row.shift:.2f}, touching on {row.touching:.1f}")
            axis.autoscale_view()
        for axis in axes[:, 0]:
            axis.set_ylabel("y (-)")
        for axis in axes[-1]:
            axis.set_xlabel("x (-)")
        label = "stress along the beams / E (-)"
        left.colorbar(colours, ax=axes, label=label, extend="both", pad=0.01, shrink=0.9)
        self.draw_forces(right.subplots(), lines)
        save(figure, filename)

    def draw_forces(self, axis, lines):
        """Draw both force components over the shift for each mesh, and mark the drawn states."""
        for (name, rows), style in zip(lines.items(), ("o", "-"), strict=True):
            shift = [row.shift for row in rows]
            for key, colour in (("fx", "tab:blue"), ("fy", "tab:red")):
                force = [getattr(row, key) for row in rows]
                axis.plot(shift, force, style, color=colour, ms=2.5, label=f"{key}, {name}")
        for row, _ in self.states:
            axis.plot([row.shift] * 2, [row.fx, row.fy], "s", color="black", ms=6, mfc="none")
        axis.set_title("force on the upper beam's ends")
        axis.set(xlabel="shift (-)", ylabel="force / (E length) (-)")
        axis.grid()
        axis.legend()
