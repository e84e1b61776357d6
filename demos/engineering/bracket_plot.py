"""Draw the picture of the bracket. Collective: data are gathered on rank 0, which draws."""

import numpy as np

from dolfinx import fem

from bracket_bodies import HALF_WIDTH, LEG
from common.drawing import (
    boundary,
    cell_values,
    draw_triangles,
    gather,
    node_values,
    pyplot,
    save,
    set_view,
    steps_of_colour,
)

SCALE = 10.0  # scale factor of displacements


def skin(part):
    """Return triangles of a part's boundary, both halves, and their von Mises stress; or None."""
    u = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 1, (3,))))
    u.interpolate(part.u)
    x, stress = part.mesh.geometry.x, cell_values(part.mesh, part.von_mises())
    nodes, behind = boundary(part.mesh, x)
    nodes, behind = (a[~np.all(x[nodes, 1] == 0, axis=1)] for a in (nodes, behind))
    found = gather(part.mesh.comm, (x + SCALE * node_values(u))[nodes], stress[behind])
    if found is None:
        return None
    other = found[0][:, ::-1] * [1, -1, 1]
    return np.concatenate([found[0], other]), np.tile(found[1], 2)


def draw(filename, result, parts, whole):
    """Draw the tied bracket, and the stress along its fillet. Collective."""
    skins = [skin(part) for part in parts]
    curves = [part.fillet_stress() for part in (parts[0], whole)]
    if skins[0] is None:
        return
    figure = pyplot().figure(figsize=(12, 5.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.3, 1))
    axis = left.add_subplot(projection="3d")
    limits = (0, LEG), (-HALF_WIDTH, HALF_WIDTH), (-4, LEG)
    set_view(axis, 22, -52, limits, zoom=0.82)
    axis.set_axis_on()
    axis.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", yticks=(-8, 8))
    axis.tick_params(axis="x", pad=-2)
    colour = steps_of_colour(max(max(stress) for _, stress in curves), "viridis")
    triangles, stress = (np.concatenate(each) for each in zip(*skins, strict=True))
    draw_triangles(axis, triangles, colour.to_rgba(stress))
    axis.set_title(f"tied parts, displacements {SCALE:.0f} times")
    left.colorbar(colour, ax=axis, label="von Mises stress (MPa)", shrink=0.7, pad=0.1)
    axis = right.subplots()
    names = "{dofs} unknowns, tied", "{dofs_matching} unknowns, one mesh"
    for (angle, values), name, style in zip(curves, names, ("o", "k-"), strict=True):
        axis.plot(angle, values, style, label=name.format(**result))
    axis.set(xlabel="angle along the fillet, from the shelf (°)", ylim=(0, None))
    axis.set(ylabel="von Mises stress (MPa)", title="fillet, middle of the width")
    axis.grid()
    axis.legend()
    save(figure, filename)
