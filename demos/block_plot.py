"""The picture of demos/block_on_block.py."""

import numpy as np
from plotting import gather, pyplot, save

KINDS = (("white", "open"), ("black", "sticks"), ("red", "slips"))


class Recorder:
    """Keeps the friction on the upper block after each step, gathered for the picture alone.

    Args:
        limit: Total friction μN at full slip; the area of contact is 1.
    """

    def __init__(self, limit):
        self.limit = limit
        self.states = []

    def __call__(self, upper, contact, row):
        """Take over a state; collective."""
        surface = contact.slave
        t = surface.node_values(contact.traction("slave", part="tangential"))
        status = contact.active().astype(int) + contact.slipping()
        nodes = gather(contact.comm, surface.node_x[:, :2], t[:, :2] / self.limit, status)
        self.states.append((row, nodes))

    def plot(self, filename):
        """Friction in the first drag, with half of the area slipping, and at the end."""
        middle = min(self.states[1:], key=lambda state: abs(state[0]["slip"] - 0.5))
        figure, axes = pyplot().subplots(1, 3, figsize=(12, 4.5), sharey=True)
        figure.subplots_adjust(left=0.05, right=0.91, bottom=0.2, top=0.94, wspace=0.06)
        for axis, state in zip(axes, (self.states[1], middle, self.states[-1]), strict=True):
            colours = draw(axis, *state)
            axis.set_xlabel("x, dragged to the right (-)")
        axes[0].set_ylabel("y (-)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=3)
        box = axes[-1].get_position()
        bar = figure.add_axes((box.x1 + 0.012, box.y0, 0.012, box.height))
        label = "friction on the upper block / (μN / area) (-)"
        figure.colorbar(colours, cax=bar, label=label, ticks=np.linspace(0, 2, 5))
        save(figure, filename)


def draw(axis, row, nodes):
    """Size and direction of the friction, and what the nodes do."""
    x, t, status = nodes
    size = np.linalg.norm(t, axis=1)
    colours = axis.tricontourf(*x.T, size, levels=np.linspace(0, 2, 21), extend="max")
    axis.quiver(*x.T, *t.T, color="white", width=0.004, scale=16, zorder=3)
    for kind, (face, label) in enumerate(KINDS):
        style = {"ms": 4.5, "mec": "black", "mew": 0.5, "clip_on": False}
        axis.plot(*x[status == kind].T, "o", color=face, label=label, **style)
    axis.set_title(f"shift {row['shift']:.3f}: T = {row['ratio']:.2f} μN")
    axis.set_aspect("equal")
    return colours
