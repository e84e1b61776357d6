"""The picture of demos/hertz.py."""

import dataclasses

from mpi4py import MPI

import numpy as np
from hertz import build
from plotting import gather, pyplot, save

KINDS = (("master-slave", "nodal"), ("quasi-symmetric", "nodal"), ("quasi-symmetric", "overlay"))


def profile(body, traction):
    """Distance from the middle and normal traction at all nodes of a surface, on rank 0."""
    surface = body.surface
    p = -np.sum(surface.node_values(traction) * surface.node_normal[:, : body.dim], axis=1)
    r = np.linalg.norm(surface.node_x[:, : body.dim - 1], axis=1)
    lines = gather(surface.comm, r, p)
    return lines and [line[np.argsort(lines[0])] for line in lines]


def plot(p, filename, comm=MPI.COMM_WORLD):
    """Traction on both sides over Hertz's pressure, for three kinds of contact."""
    panels = []
    for formulation, quadrature in KINDS:
        case = dataclasses.replace(p, formulation=formulation, quadrature=quadrature)
        hertz, slave, master, contact, problem = build(comm, case)
        problem.solve()
        sides = (("slave", slave), ("master", master))
        lines = {side: profile(body, contact.traction(side)) for side, body in sides}
        panels.append((f"{formulation}, {quadrature}", lines))
        problem.destroy()
    if comm.rank > 0:
        return
    figure, axes = pyplot().subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
    s = np.linspace(0, 1.6, 400)
    # In 3D nodes at the same distance have values of their own: no lines.
    styles = ("o-", "s-") if p.dim == 2 else ("o", "s")
    for axis, (title, lines) in zip(axes, panels, strict=True):
        for (side, (r, t)), style in zip(lines.items(), styles, strict=True):
            near = r <= 1.6 * hertz.a
            axis.plot(r[near] / hertz.a, t[near] / hertz.p0, style, ms=3, lw=0.8, label=side)
        axis.plot(s, np.sqrt(np.maximum(1 - s**2, 0)), color="black", label="Hertz")
        axis.set(title=title, xlabel="distance from the middle / a (-)")
        axis.grid()
    axes[0].legend()
    axes[0].set_ylabel("contact traction / p0 (-)")
    save(figure, filename)
