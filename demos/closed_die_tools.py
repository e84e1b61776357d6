"""Draw the tools of the closed-die demo with gmsh: dies of a wheel as STL files, one as a solid.

A wheel with hub, web and rim is forged with a flash between flat lands. The flash flows into a
gutter. Walls have a draft of 7°, edges are rounded. Lengths are in mm; the axis is z. The land of
the lower die is at z = 0, the land of the upper die at z = FLASH when the dies are closed.
"""

import itertools
import math

import numpy as np

from dolfinx import mesh

from common.bodies import gmsh_mesh

FLASH = 2.4  # thickness of the flash between the closed dies
DRAFT = math.tan(math.radians(7.0))
LAND, GUTTER = 27.0, 33.0  # radii at which land and gutter begin
EDGE = 44.0  # outer radius of the dies
NEAR = 5.8  # distance of the dies below which cells are smaller
BEYOND = math.radians(8.0)  # overhang of the dies beyond the planes of symmetry


def corners(hub, rim):
    """Return corners (r, depth, radius of the rounding) of a die from the axis to its edge.

    Args:
        hub: Depth of the hub below the land.
        rim: Depth of the rim below the land.
    """
    web = 2.0
    inner, outer = 9.5, 18.0  # radii of the web, half way down its walls
    return [
        (0.0, hub, 0.0),
        (inner - DRAFT * (hub - web), hub, 3.0),
        (inner, web, 3.0),
        (outer, web, 3.0),
        (outer + DRAFT * (rim - web), rim, 2.5),
        (LAND - DRAFT * rim, rim, 3.0),
        (LAND, 0.0, 2.5),
        (GUTTER, 0.0, 1.0),
        (GUTTER + 3.0, 3.0, 1.0),
        (EDGE, 3.0, 0.0),
    ]


DIES = {"lower": corners(hub=9.0, rim=7.0), "upper": corners(hub=11.0, rim=7.0)}


def height(die, depth):
    """Return z for a depth below the land, with closed dies."""
    return -depth if die == "lower" else FLASH + depth


def segments(die):
    """Return lines (start, end) and arcs (start, centre, end) of a profile, points (r, z)."""
    points = [np.array([r, height(die, depth)]) for r, depth, _ in DIES[die]]
    out, start = [], points[0]
    for before, corner, after, (*_, radius) in zip(
        points, points[1:], points[2:], DIES[die][1:], strict=False
    ):
        back, forth = (p - corner for p in (before, after))
        back, forth = back / np.linalg.norm(back), forth / np.linalg.norm(forth)
        half = math.acos(back @ forth) / 2
        middle = (back + forth) / np.linalg.norm(back + forth)
        first, last = (corner + radius / math.tan(half) * d for d in (back, forth))
        if (first - start) @ back > 0:
            raise ValueError(f"{die} die: roundings overlap before (r, z) = {corner}")
        out += [(start, first), (first, corner + radius / math.sin(half) * middle, last)]
        start = last
    return [*out, (start, points[-1])]


def profile(die, number=40):
    """Return points (r, z) along the profile of a die, with arcs as many chords."""
    out = []
    for start, *centre, end in segments(die):
        s = np.linspace(0, 1, number)[:, None]
        chord = start + s * (end - start)
        if centre:
            ray = chord - centre[0]
            radius = np.linalg.norm(start - centre[0])
            chord = centre[0] + radius * ray / np.linalg.norm(ray, axis=1)[:, None]
        out.append(chord)
    return np.concatenate(out)


def cavity(radius=LAND):
    """Compute the volume between the closed dies within a radius, all around the axis."""
    r = np.linspace(0, radius, 20001)
    lower, upper = (np.interp(r, *profile(die).T) for die in ("lower", "upper"))
    return 2 * np.pi * np.trapezoid(r * (upper - lower), r)


def cell_size(x, way, largest, smallest):
    """Return the size of the billet's cells: smaller where the dies are near each other.

    Args:
        x: Points, shape (3, n).
        way: Remaining stroke of the upper die.
        largest: Largest size.
        smallest: Smallest size.
    """
    r = np.hypot(x[0], x[1])
    lower, upper = (np.interp(r, *profile(die).T) for die in ("lower", "upper"))
    return np.clip(largest * (upper - lower + way) / NEAR, smallest, largest)


def draw_profile(gmsh, die, back=None):
    """Draw curves of a profile in the plane y = 0, closed by a block behind it to z = back."""
    occ = gmsh.model.occ

    def add(p):
        return occ.addPoint(p[0], 0.0, p[1])

    parts = segments(die)
    first = last = add(parts[0][0])
    curves = []
    for _, *centre, end in parts:
        before, last = last, add(end)
        if centre:
            curves.append(occ.addCircleArc(before, add(centre[0]), last))
        else:
            curves.append(occ.addLine(before, last))
    if back is not None:
        behind = [last, add((EDGE, back)), add((0.0, back)), first]
        curves += [occ.addLine(*pair) for pair in itertools.pairwise(behind)]
    return curves


def write_stl(die, filename, size):
    """Write the face of a die, a little more than a quarter of it, as a binary STL file.

    Triangles are counter-clockwise seen from the cavity. As there are no undercuts, all triangles
    are visible from above; those of the upper die from below.

    Args:
        die: "lower" or "upper".
        filename: The file.
        size: Largest size of the triangles; on the roundings they are smaller.
    """
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    curves = [(1, tag) for tag in draw_profile(gmsh, die)]
    occ.rotate(curves, 0, 0, 0, 0, 0, 1, -BEYOND)
    occ.revolve(curves, 0, 0, 0, 0, 0, 1, math.pi / 2 + 2 * BEYOND)
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.removeDuplicateNodes()
    tags, x, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    _, nodes = gmsh.model.mesh.getElementsByType(2)
    gmsh.finalize()
    corner = x.reshape(-1, 3)[row[nodes].reshape(-1, 3)]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    turned = normal[:, 2] * (1 if die == "lower" else -1) < 0
    corner[turned] = corner[turned][:, ::-1]
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(len(corner), dtype=facet)
    facets["corners"] = corner
    with open(filename, "wb") as file:
        file.write(f"{die} die, mm".encode().ljust(80))
        file.write(np.uint32(len(facets)).tobytes() + facets.tobytes())


def die_mesh(comm, die, size, coarse, thickness=25.0):
    """Mesh a quarter of a die with tetrahedra, for its stresses; cells grow away from its face.

    Args:
        comm: Communicator.
        die: "lower" or "upper".
        size: Size of the cells on the face.
        coarse: Size of the cells at the back.
        thickness: Thickness from the land to the back.
    """
    face = profile(die, 10).T

    def at(dim, tag, x, y, z, _):
        r = math.hypot(x, y)
        behind = max(abs(np.interp(r, *face) - z), 0.7 * (r - GUTTER))
        return min(coarse, size + 0.4 * behind)

    def draw(gmsh):
        occ = gmsh.model.occ
        loop = occ.addCurveLoop(draw_profile(gmsh, die, height(die, thickness)))
        occ.revolve([(2, occ.addPlaneSurface([loop]))], 0, 0, 0, 0, 0, 1, math.pi / 2)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.model.mesh.setSizeCallback(at)

    return gmsh_mesh(comm, 3, draw)


def billet_size(radius, flash):
    """Compute the height of a billet that fills the cavity and a share of it more as flash."""
    return (1 + flash) * cavity() / (np.pi * radius**2)


def billet_mesh(comm, radius, flash, size):
    """Mesh a quarter of the billet, which stands on the web of the lower die, with tetrahedra."""
    bottom = height("lower", DIES["lower"][2][1])

    def draw(gmsh):
        tall = billet_size(radius, flash)
        gmsh.model.occ.addCylinder(0, 0, bottom, 0, 0, tall, radius, angle=math.pi / 2)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)

    return gmsh_mesh(comm, 3, draw)


def skin(msh):
    """Find the facets of a quarter's boundary that are on no plane of symmetry."""
    msh.topology.create_connectivity(2, 3)
    outside = mesh.exterior_facet_indices(msh.topology)
    scale = 1e-9 * EDGE
    planes = [
        mesh.locate_entities_boundary(msh, 2, lambda x, axis=axis: np.abs(x[axis]) < scale)
        for axis in (0, 1)
    ]
    return np.setdiff1d(outside, np.concatenate(planes)).astype(np.int32)
