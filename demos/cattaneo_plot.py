"""The picture of demos/cattaneo_mindlin.py."""

import numpy as np
from plotting import gather, pyplot, save


def profile(surface, tractions):
    """X, normal and tangential traction at all nodes of a surface, on rank 0; None elsewhere."""
    lines = gather(surface.comm, surface.node_x[:, 0], *tractions)
    return lines and [line[np.argsort(lines[0])] for line in lines]


def draw(exact, mu, columns, filename):
    """Normal traction above, tangential traction below.

    Args:
        exact: The closed form.
        mu: Coefficient of friction.
        columns: Title and profile by side, for each kind of contact.
        filename: Of the picture.
    """
    figure, axes = pyplot().subplots(
        2,
        len(columns),
        figsize=(11, 7),
        sharex=True,
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    rows = (
        ("normal traction / p0 (-)", exact.p0, exact.normal),
        ("tangential traction / (μ p0) (-)", mu * exact.p0, exact.tangential),
    )
    for column, (title, lines) in zip(axes.T, columns, strict=True):
        column[0].set_title(title)
        column[1].set_xlabel("x / b (-)")
        for i, (_, unit, function) in enumerate(rows):
            one_panel(column[i], exact.a, unit, function, lines, i + 1)
    for axis, (label, _, _) in zip(axes[:, 0], rows, strict=True):
        axis.set_ylabel(label)
    axes[0, 0].legend()
    save(figure, filename)


def one_panel(axis, b, unit, function, lines, part):
    """One traction on both sides over its closed form."""
    s = np.linspace(-1.3, 1.3, 2001)
    for (side, line), style in zip(lines.items(), ("o-", "s-"), strict=True):
        near = np.abs(line[0]) <= 1.3 * b
        axis.plot(line[0][near] / b, line[part][near] / unit, style, ms=2.5, lw=0.7, label=side)
    axis.plot(s, function(s * b) / unit, color="black", lw=1, label="closed form")
    axis.grid()
