"""Picture of the ironing: deformed meshes in the middle of the slide, and forces over the slide."""

import dataclasses

from mpi4py import MPI

import numpy as np
from ironing import PRESSING, on_plateau, slide
from plotting import cells, draw_cells, node_values, pyplot, save

import ufl

VARIANTS = (
    ("master-slave, nodal", {"formulation": "master-slave", "quadrature": "nodal"}),
    ("quasi-symmetric, nodal", {"formulation": "quasi-symmetric", "quadrature": "nodal"}),
    ("quasi-symmetric, overlay", {"formulation": "quasi-symmetric", "quadrature": "overlay"}),
)
COLOURS = ("tab:red", "tab:blue", "black")


def deformed(body):
    """Deformed cells and the Cauchy shear stress in them, on rank 0; for the picture only."""
    F = ufl.Identity(2) + ufl.grad(body.u)
    shear = (body.stress * F.T / ufl.det(F))[0, 1]
    return cells(body.mesh, node_values(body.u), shear)


def draw_meshes(axis, bodies):
    """Both bodies around the contact, in true proportions."""
    limit = max(np.abs(shear).max() for _, shear in bodies[1:])
    for corners, shear in bodies:
        drawn = draw_cells(axis, corners, shear, cmap="RdBu_r", clim=(-limit, limit))
    x = bodies[0][0]
    middle, half = 0.5 * (x[..., 0].min() + x[..., 0].max()), 2.2
    axis.set(xlim=(middle - half, middle + half), ylim=(-1.02, 0.8))
    axis.set(xlabel="x / height of the slab (-)", ylabel="y / height of the slab (-)")
    axis.set_title("deformed meshes in the middle of the slide to the right, overlay")
    label = "shear stress / E of the slab (-)"
    axis.figure.colorbar(drawn, ax=axis, label=label, extend="both", pad=0.01)


def draw_forces(axes, p, lines):
    """Fx, Fy over the means of the plateau, and their ratio, in percent."""
    for (title, rows), colour in zip(lines, COLOURS, strict=True):
        columns, _ = on_plateau(p, rows)
        sliding = [row for row in rows if row.t > PRESSING]
        place = [row.slide for row in sliding]
        for axis, name in zip(axes, ("fx", "fy"), strict=False):
            mean = np.average(getattr(columns, name), weights=columns.dt)
            force = np.array([getattr(row, name) for row in sliding])
            axis.plot(place, 100 * (force / mean - 1), "-", color=colour, lw=1, label=title)
        ratio = [abs(row.fx / row.fy) for row in sliding]
        axes[2].plot(place, ratio, color=colour, lw=1)
    axes[0].set(ylim=(-2.6, 2.6), ylabel="Fx, off its mean on the plateau (%)")
    axes[1].set(ylim=(-0.5, 0.5), ylabel="Fy, off its mean on the plateau (%)")
    axes[2].set(ylim=(0.97 * p.mu, 1.03 * p.mu), ylabel="|Fx / Fy| (-); dashed: μ")
    axes[2].axhline(p.mu, color="grey", ls="--", lw=1)
    for axis in axes:
        axis.axvspan(0, on_plateau(p, lines[0][1])[1].slide, color="0.93", zorder=0)
        axis.set(xlabel="slide (facets of the slab)", xlim=(0, None))
        axis.grid()
    axes[0].legend(loc="lower right")


def plot(p, filename, comm=MPI.COMM_WORLD):
    """Iron with three kinds of contact and draw them."""
    lines, bodies = [], []

    def at_middle(row, scene):
        if not bodies and row.t >= PRESSING + sum(p.plan()) / 2:
            bodies.extend(deformed(body) for body in scene[:2])

    for title, options in VARIANTS:
        bodies.clear()
        case = dataclasses.replace(p, **options)
        lines.append((title, slide(case, comm, at_middle)[0]))
    if comm.rank > 0:
        return
    figure = pyplot().figure(figsize=(12, 7.4), layout="constrained")
    rows = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    draw_meshes(rows[0].subplots(), bodies)
    draw_forces(rows[1].subplots(1, 3), p, lines)
    save(figure, filename)
