"""Drawing functions for the pictures of the demos: optional matplotlib, one style, small files.

Nodes, cells and their values are gathered on rank 0 for the picture only. No computation needs them
in one place.
"""

import io

import numpy as np

import basix
from dolfinx import fem, mesh

from qsdolfinx.compat import cell_nodes, interpolation_points

STYLE = {
    "savefig.dpi": 110,
    "font.size": 9.5,
    "axes.titlesize": 10,
    "legend.fontsize": 8.5,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
}
LARGE = 145e3  # size of a PNG file in bytes
#: Direction towards the light, for bodies in 3D.
LIGHT = np.array([0.3, 0.5, 0.81])
STEEL = (0.95, 0.55, 0.35, 1.0)  # hot end of the colour scale
GREY = (0.78, 0.78, 0.8, 1.0)


# --- Files


def pyplot():
    """Return matplotlib.pyplot without a display, in the style of all pictures."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update(STYLE)
    return plt


def save(figure, filename):
    """Write a figure; a large PNG is reduced to 256 colours, a third of its size."""
    if str(filename).lower().endswith(".png"):
        from PIL import Image

        figure.savefig(full := io.BytesIO(), format="png")
        picture = Image.open(full).convert("RGB")
        if len(full.getvalue()) > LARGE:
            options = {"method": Image.Quantize.MAXCOVERAGE, "kmeans": 1}
            picture = picture.quantize(256, dither=Image.Dither.NONE, **options)
        picture.save(filename, optimize=True)
    else:
        figure.savefig(filename)
    pyplot().close(figure)


# --- Data gathered for the picture only


def gather(comm, *arrays):
    """Concatenate the arrays of all ranks on rank 0; None elsewhere. Collective."""
    parts = comm.gather(arrays)
    if parts is None:
        return None
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


def node_values(u):
    """Return a vector field at the vertices, in the order of the nodes of the mesh geometry."""
    V = u.function_space
    out = np.zeros((len(V.mesh.geometry.x), V.dofmap.bs))
    # One node of the space and one node of the geometry at each vertex; these come first in a cell.
    number = len(basix.geometry(V.mesh.basix_cell()))
    at_vertices = V.dofmap.list[:, :number]
    out[cell_nodes(V.mesh)[:, :number]] = u.x.array.reshape(-1, V.dofmap.bs)[at_vertices]
    return out


def cell_values(msh, value):
    """Interpolate a UFL expression as one value per cell."""
    space = fem.functionspace(msh, ("DG", 0))
    function = fem.Function(space)
    function.interpolate(fem.Expression(value, interpolation_points(space)))
    return function.x.array[space.dofmap.list[:, 0]]


def cells(msh, displacement=0.0, value=None):
    """Return the corners of the cells of a mesh in 2D, on rank 0. Collective.

    Args:
        msh: Mesh.
        displacement: Displacement added at the nodes.
        value: UFL expression of the colour.

    Returns:
        Corners and values of all cells on rank 0; None on other ranks.
    """
    own = msh.topology.index_map(2).size_local
    values = np.zeros(own) if value is None else cell_values(msh, value)[:own]
    corners = (msh.geometry.x[:, :2] + displacement)[cell_nodes(msh)[:own]]
    around = [0, 1, 2] if msh.topology.cell_type == mesh.CellType.triangle else [0, 1, 3, 2]
    return gather(msh.comm, corners[:, around], values)


def boundary(msh, x):
    """Return the boundary triangles of a mesh of tetrahedra that this rank owns.

    Args:
        msh: Mesh.
        x: Positions of its nodes.

    Returns:
        Nodes of each triangle, ordered so that normals point outwards, and the cell of each.
    """
    msh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(msh.topology)
    if len(facets) == 0:
        return np.zeros((0, 3), dtype=np.int32), np.zeros(0, dtype=np.int32)
    nodes = mesh.entities_to_geometry(msh, 2, facets)
    behind = msh.topology.connectivity(2, 3)
    behind = behind.array[behind.offsets[facets]]
    inwards = x[cell_nodes(msh)[behind]].mean(axis=1) - x[nodes[:, 0]]
    turned = np.sum(normals(x[nodes]) * inwards, axis=1) > 0
    nodes[turned] = nodes[turned][:, ::-1]
    return nodes, behind


# --- Drawing, on rank 0


def normals(triangles):
    """Return unit normals."""
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return n / np.linalg.norm(n, axis=1)[:, None]


def draw_cells(axis, corners, values=None, **options):
    """Draw cells in 2D with their values; without values, only their edges."""
    from matplotlib.collections import PolyCollection

    options = {"edgecolor": "0.3", "linewidth": 0.4} | options
    if values is None:
        options = {"facecolor": "0.92"} | options
    out = axis.add_collection(PolyCollection(corners, array=values, **options))
    axis.set_aspect("equal")
    return out


def set_view(axis, elevation, azimuth, limits, zoom=1.1):
    """Set a parallel projection without axes, with equal scales."""
    axis.set_proj_type("ortho")
    axis.view_init(elev=elevation, azim=azimuth)
    axis.set(**dict(zip(("xlim", "ylim", "zlim"), limits, strict=True)))
    axis.set_box_aspect([high - low for low, high in limits], zoom=zoom)
    axis.set_axis_off()


def steps_of_colour(largest, name, number=12):
    """Return colours for 0 to a value in round steps, few enough for the palette of a GIF."""
    from matplotlib import cm, colors, ticker

    bounds = ticker.MaxNLocator(number).tick_values(0, largest)
    return cm.ScalarMappable(colors.BoundaryNorm(bounds, 256), name)


def draw_triangles(axis, triangles, colours, **options):
    """Project the 3D triangles that face the viewer, with colours lit from above (RGBA)."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    up, around = np.radians(axis.elev), np.radians(axis.azim)
    viewer = np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)
    normal = normals(triangles)
    seen = normal @ viewer > 0
    shaded = np.array(colours, dtype=float)[seen]
    shaded[:, :3] *= (0.65 + 0.35 * np.abs(normal[seen] @ LIGHT))[:, None]
    options = {"edgecolor": (0, 0, 0, 0.35), "linewidth": 0.2, "clip_on": False} | options
    axis.add_collection3d(Poly3DCollection(triangles[seen], facecolors=shaded, **options))
