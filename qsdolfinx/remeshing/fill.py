"""Fill a new boundary with cells, by gmsh."""

from __future__ import annotations

import contextlib
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.outline import Outline, listed
from qsdolfinx.remeshing.parts import find_parts, in_voids
from qsdolfinx.remeshing.retriangulate import Boundary

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Numbers of gmsh's algorithms in the order in which they are tried: Delaunay, frontal, HXT;
#: MeshAdapt.
ALGORITHMS = {2: (6, 5, 1), 3: (1, 4, 10)}

#: gmsh's numbers of lines, triangles and tetrahedra.
LINE, TRIANGLE, TETRAHEDRON = 1, 2, 4

#: Quality, 1 is best, below which a cell is rejected as too flat. A flat cell has an infinite
#: stiffness; with much more, usual meshes would be rejected.
LEAST_QUALITY = 0.01


class Inside(typing.NamedTuple):
    """Cells within a boundary.

    Attributes:
        x: Nodes, shape (nodes, 3), boundary nodes first.
        cells: Shape (cells, gdim + 1).
    """

    x: Array
    cells: Indices

    def within(
        self, boundary: Boundary, moved: typing.Callable[[Array], Array]
    ) -> tuple[Array, Indices]:
        """Nodes and cells in the body, mapped from its copy with these nodes.

        Args:
            boundary: Boundary of the body.
            moved: Map from places in the copy, shape (nodes, 3), to places in the body.

        Raises:
            RemeshError: If cells become flat, or are turned inside out.
        """
        count = len(boundary.x)
        x = np.vstack([boundary.x, moved(self.x[count:])])
        turned = signed_sizes(x, self.cells) * signed_sizes(self.x, self.cells) <= 0
        if turned.any():
            at = x[self.cells[turned]].mean(axis=1)
            raise RemeshError.at(f"{turned.sum()} cells of the new mesh turn inside out", at)
        check_cells(x, self.cells)
        return x, self.cells


def signed_sizes(x: Array, cells: Indices) -> Array:
    """Signed volumes (2D: areas) of simplices times 6 (2); the sign is that of the orientation."""
    corners = x[cells][..., : cells.shape[1] - 1]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]))


def fill(boundary: Boundary, outline: Outline) -> Inside:
    """Create nodes and cells within a boundary; boundary nodes come first and are not moved.

    Args:
        boundary: The boundary.
        outline: The old body, whose cell sizes apply within the boundary, too.

    Raises:
        RemeshError: If gmsh fails, or creates cells that are flat or inverted.
        ImportError: If there is no gmsh.
    """
    gdim = boundary.facets.shape[1]
    problems: list[RemeshError] = []
    for algorithm in ALGORITHMS[gdim]:
        try:
            with _gmsh() as gmsh:
                inside = _fill(gmsh, boundary, outline, algorithm)
            check_cells(*inside)
            return inside
        except RemeshError as error:
            problems.append(error)
    raise problems[0]


@contextlib.contextmanager
def _gmsh() -> typing.Iterator[typing.Any]:
    """Gmsh with a new model and its own options; models of the user are unchanged."""
    try:
        import gmsh
    except ImportError as error:
        raise ImportError("remesh: needs gmsh's Python module; install python3-gmsh") from error
    mine = not gmsh.isInitialized()
    if mine:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    before = None if mine else gmsh.model.getCurrent()
    views = set() if mine else set(gmsh.view.getTags())
    options = {"General.Terminal": 0.0, "General.NumThreads": 1.0, "Mesh.RandomSeed": 1.0}
    kept = {name: gmsh.option.getNumber(name) for name in (*options, *_OPTIONS)}
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.add("qsdolfinx")
    try:
        yield gmsh
    finally:
        gmsh.model.remove()
        for view in set(gmsh.view.getTags()) - views:
            gmsh.view.remove(view)
        if mine:
            gmsh.finalize()
        else:
            for name, value in kept.items():
                gmsh.option.setNumber(name, value)
            gmsh.model.setCurrent(before)


_OPTIONS = (
    "Mesh.MeshSizeExtendFromBoundary",
    "Mesh.MeshSizeFromPoints",
    "Mesh.MeshSizeMin",
    "Mesh.MeshSizeMax",
    "Mesh.Algorithm",
    "Mesh.Algorithm3D",
    "Mesh.Optimize",
    "Mesh.OptimizeNetgen",
    "Mesh.OptimizeThreshold",
)


def _fill(gmsh: typing.Any, boundary: Boundary, outline: Outline, algorithm: int) -> Inside:
    gdim = boundary.facets.shape[1]
    _set_sizes(gmsh, boundary, outline)
    draw = _draw_lines if gdim == 2 else _draw_triangles
    draw(gmsh, boundary)
    gmsh.option.setNumber("Mesh.Algorithm" if gdim == 2 else "Mesh.Algorithm3D", algorithm)
    gmsh.option.setNumber("Mesh.Optimize", 1)
    gmsh.option.setNumber("Mesh.OptimizeNetgen", 0)
    gmsh.option.setNumber("Mesh.OptimizeThreshold", 0.5)  # quality, 1 is best
    gmsh.logger.start()
    try:
        gmsh.model.mesh.generate(gdim)
        if gdim == 3:
            gmsh.model.mesh.optimize("Relocate3D")
    except Exception as error:
        said = [line for line in gmsh.logger.get() if not line.startswith("Info")]
        text = f"gmsh cannot fill the boundary: {error}" + (f" ({said[-1]})" if said else "")
        raise RemeshError(text, _middle(boundary)) from error
    finally:
        gmsh.logger.stop()
    return _read(gmsh, boundary)


def _middle(boundary: Boundary) -> Array:
    return np.asarray(boundary.x.mean(axis=0)[None])


def _set_sizes(gmsh: typing.Any, boundary: Boundary, outline: Outline) -> None:
    """Set the cell sizes within the body from the old cells and the new boundary."""
    sizes = outline.sizes
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", float(min(sizes.min(), boundary.sizes.min())) / 2)
    gmsh.option.setNumber("Mesh.MeshSizeMax", float(sizes.max()))
    if np.ptp(sizes) <= 1e-9 * sizes.max():
        return
    view = gmsh.view.add("sizes")
    x = outline.x[outline.cells].transpose(0, 2, 1).reshape(len(outline.cells), -1)
    data = np.hstack([x, sizes[outline.cells]])
    kind = "ST" if outline.gdim == 2 else "SS"
    gmsh.view.addListData(view, kind, len(data), data.ravel())
    field = gmsh.model.mesh.field.add("PostView")
    gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)


def _draw_triangles(gmsh: typing.Any, boundary: Boundary) -> None:
    # The boundary is one surface, even if it has several parts: voids are filled, too, and emptied
    # afterwards.
    surface = gmsh.model.addDiscreteEntity(2)
    numbers = np.arange(1, len(boundary.x) + 1)
    gmsh.model.mesh.addNodes(2, surface, numbers, boundary.x.ravel())
    elements = np.arange(1, len(boundary.facets) + 1)
    nodes = (boundary.facets + 1).ravel()
    gmsh.model.mesh.addElementsByType(surface, TRIANGLE, elements, nodes)
    loop = gmsh.model.geo.addSurfaceLoop([surface])
    gmsh.model.geo.addVolume([loop])
    gmsh.model.geo.synchronize()


def _draw_lines(gmsh: typing.Any, boundary: Boundary) -> None:
    for node, x in enumerate(boundary.x, 1):
        gmsh.model.geo.addPoint(*x, tag=node)
    for facet, (a, b) in enumerate(listed(boundary.facets), 1):
        gmsh.model.geo.addLine(a + 1, b + 1, tag=facet)
        gmsh.model.geo.mesh.setTransfiniteCurve(facet, 2)
    for shells in find_parts(boundary.x, boundary.facets):
        loops = [_in_order(boundary.facets, shell) for shell in shells]
        curves = [gmsh.model.geo.addCurveLoop([facet + 1 for facet in loop]) for loop in loops]
        gmsh.model.geo.addPlaneSurface(curves)
    gmsh.model.geo.synchronize()


def _in_order(facets: Indices, shell: Indices) -> list[int]:
    """Facets of a closed line, in order."""
    by_start = dict(zip(listed(facets[shell, 0]), listed(shell), strict=True))
    loop = [int(shell[0])]
    while (following := by_start[int(facets[loop[-1], 1])]) != loop[0]:
        loop.append(following)
    return loop


def _read(gmsh: typing.Any, boundary: Boundary) -> Inside:
    """Read the nodes, boundary nodes first, and cells of the model."""
    gdim = boundary.facets.shape[1]
    tags, x, _ = gmsh.model.mesh.getNodes()
    tags, x = np.asarray(tags, dtype=np.int64), np.asarray(x).reshape(-1, 3)
    _, nodes = gmsh.model.mesh.getElementsByType(TRIANGLE if gdim == 2 else TETRAHEDRON)
    cells: Indices = np.asarray(nodes, dtype=np.int64).reshape(-1, gdim + 1)
    count = len(boundary.x)
    if gdim == 3 and any(len(shells) > 1 for shells in find_parts(boundary.x, boundary.facets)):
        place = np.zeros((int(tags.max(initial=0)) + 1, 3))
        place[tags] = x
        cells = cells[~in_voids(place, cells, boundary.x, boundary.facets)]
    number = np.full(int(tags.max(initial=0)) + 1, -1)
    used = np.unique(cells)
    inner = used[used > count]
    number[1 : count + 1] = np.arange(count)
    number[inner] = count + np.arange(len(inner))
    position = np.empty((int(tags.max(initial=0)) + 1, 3))
    position[tags] = x
    out = np.vstack([boundary.x, position[inner]])
    missing = np.setdiff1d(np.arange(1, count + 1), used)
    if len(missing) or len(cells) == 0:
        where = boundary.x[missing - 1] if len(missing) else _middle(boundary)
        raise RemeshError.at("gmsh has left out nodes of the boundary", where)
    return Inside(out, number[cells])


def cell_quality(x: Array, cells: Indices) -> Array:
    """Quality of each cell as in ``MeshMotion.quality``, for any orientation, (cells,)."""
    corners = x[cells]
    gdim = cells.shape[1] - 1
    edges = (corners[:, 1:] - corners[:, :1])[..., :gdim]
    pairs = corners[:, :, None] - corners[:, None]
    longest = np.linalg.norm(pairs, axis=-1).max(axis=(1, 2))
    best = np.sqrt(3) / 2 if gdim == 2 else np.sqrt(0.5)
    return np.asarray(np.abs(np.linalg.det(edges)) / longest**gdim / best)


def check_cells(x: Array, cells: Indices) -> None:
    """Raise an error for flat cells.

    Raises:
        RemeshError: If there are any, with the places of the worst cells.
    """
    quality = cell_quality(x, cells)
    flat = quality < LEAST_QUALITY
    if flat.any():
        order = np.argsort(quality[flat])
        raise RemeshError.at(
            f"{flat.sum()} cells of the new mesh are flat", x[cells[flat][order]].mean(axis=1)
        )
