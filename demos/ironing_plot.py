"""Picture of the ironing: deformed meshes in the middle of the slide, and forces over the slide."""

import dataclasses

from mpi4py import MPI

import matplotlib
import numpy as np
from ironing import PRESSING, on_plateau, slide

import ufl
from dolfinx import fem

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

VARIANTS = (
    ("master-slave, nodal", {"formulation": "master-slave", "quadrature": "nodal"}),
    ("quasi-symmetric, nodal", {"formulation": "quasi-symmetric", "quadrature": "nodal"}),
    ("quasi-symmetric, overlay", {"formulation": "quasi-symmetric", "quadrature": "overlay"}),
)
COLOURS = ("tab:red", "tab:blue", "black")


def deformed(comm, body):
    """Deformed cells and the Cauchy shear stress in them, on rank 0; for the picture only."""
    space = fem.functionspace(body.mesh, ("DG", 0))
    F = ufl.Identity(2) + ufl.grad(body.u)
    shear = (body.stress * F.T / ufl.det(F))[0, 1]
    points = space.element.interpolation_points
    value = fem.Function(space)
    value.interpolate(fem.Expression(shear, points() if callable(points) else points))
    own = body.mesh.topology.index_map(2).size_local
    nodes, dofs = body.mesh.geometry.dofmap[:own], body.V.dofmap.list[:own]
    # Q1: one node of the space and one of the geometry at each vertex.
    x = body.mesh.geometry.x[nodes][:, :, :2] + body.u.x.array.reshape(-1, 2)[dofs]
    parts = comm.gather((x[:, [0, 1, 3, 2]], value.x.array[space.dofmap.list[:own, 0]]))
    if comm.rank > 0:
        return None
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def draw_meshes(axis, bodies):
    """Both bodies around the contact, in true proportions."""
    limit = max(np.abs(shear).max() for _, shear in bodies[1:])
    for x, shear in bodies:
        cells = PolyCollection(x, array=shear, cmap="RdBu_r", edgecolor="0.3", linewidth=0.4)
        cells.set_clim(-limit, limit)
        axis.add_collection(cells)
    x = bodies[0][0]
    middle, half = 0.5 * (x[..., 0].min() + x[..., 0].max()), 2.2
    axis.set(xlim=(middle - half, middle + half), ylim=(-1.02, 0.8), aspect="equal")
    axis.set_title("deformed meshes in the middle of the slide to the right, overlay", fontsize=10)
    axis.figure.colorbar(axis.collections[0], ax=axis, label="shear stress / E of the slab")


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
    axes[0].set(ylim=(-2.6, 2.6), title="Fx, off its mean on the plateau (%)")
    axes[1].set(ylim=(-0.5, 0.5), title="Fy, off its mean on the plateau (%)")
    axes[2].set(ylim=(0.97 * p.mu, 1.03 * p.mu), title="|Fx / Fy|; dashed: μ")
    axes[2].axhline(p.mu, color="grey", ls="--", lw=1)
    for axis in axes:
        axis.axvspan(0, on_plateau(p, lines[0][1])[1].slide, color="0.93", zorder=0)
        axis.set(xlabel="slide (facets of the slab)", xlim=(0, None))
        axis.title.set_fontsize(10)
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8, loc="lower right")


def plot(p, filename, comm=MPI.COMM_WORLD):
    """Iron with three kinds of contact and draw them."""
    lines, bodies = [], []

    def at_middle(row, scene):
        if not bodies and row.t >= PRESSING + sum(p.plan()) / 2:
            bodies.extend(deformed(comm, body) for body in scene[:2])

    for title, options in VARIANTS:
        bodies.clear()
        case = dataclasses.replace(p, **options)
        lines.append((title, slide(case, comm, at_middle)[0]))
    if comm.rank > 0:
        return
    figure = plt.figure(figsize=(13, 8), layout="constrained")
    rows = figure.subfigures(2, 1)
    draw_meshes(rows[0].subplots(), bodies)
    draw_forces(rows[1].subplots(1, 3), p, lines)
    figure.savefig(filename, dpi=110)
