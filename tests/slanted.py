"""A block with slanted sides; with weighted gaps its corners sink into a plane."""

import numpy as np
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem, mesh

import qsdolfinx as qs


def slanted_block(gdim=2, n=8, tool="plane", finite=False, **options):
    """A block that widens upwards by 0.5 per unit height; its bottom and sides are in contact.

    Args:
        gdim: Dimension of space.
        n: Number of cells along each axis.
        tool: ``"plane"``, or the same plane made of ``"facets"``.
        finite: Whether the gaps are those of the deformed block.
        options: Options of the contact.

    Returns:
        Return the contact, and the depth of the deepest node below the plane.
    """
    low, high, up = [-0.5] * (gdim - 1) + [0.0], [0.5] * (gdim - 1) + [1.0], gdim - 1
    if gdim == 2:
        crossed = mesh.DiagonalType.left_right
        msh = mesh.create_rectangle(WORLD, [low, high], [n, n], diagonal=crossed)
    else:
        msh = box(WORLD, (n,) * 3, "hexahedron", low, high, "scattered")
    msh.geometry.x[:, :up] *= 1 + msh.geometry.x[:, [up]]
    V = vector_space(msh)
    u, top = fem.Function(V), plane(msh, up, 1.0)
    every = mesh.locate_entities_boundary(msh, up, lambda x: np.full(x.shape[1], True))
    surface = qs.Surface(V, facets=np.setdiff1d(every, top))
    axis = np.eye(gdim)[up]
    if tool == "plane":
        floor = qs.RigidSurface.plane(WORLD, point=0 * axis, normal=axis)
    elif gdim == 2:
        x = [[2.0, 0.0], [0.37, 0.0], [-0.21, 0.0], [-2.0, 0.0]]
        floor = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2], [2, 3]])
    else:
        x = [[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]]
        floor = qs.RigidSurface.triangulated(WORLD, x, [[0, 1, 2], [0, 2, 3]])
    how = {"sliding": "finite"} if finite else {"quadrature": "overlay"}
    contact = qs.Contact(surface, floor, search_radius=0.14, **how, **options)
    problem = qs.ContactProblem(
        [elastic(u, E=1e3)], [u], [contact], [[clamp(V, top, -0.05 * axis)]]
    )
    problem.solve()
    y = (V.tabulate_dof_coordinates()[:, up] + u.x.array.reshape(-1, gdim)[:, up]).min()
    return contact, -min(WORLD.allgather(float(y)))
