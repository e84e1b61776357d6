"""Remeshing of a body in its present configuration."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import fem, mesh

from qsdolfinx.base.checks import (
    FLAG,
    FRACTION,
    POSITIVE,
    TAGS,
    check,
    either,
    instance,
    number,
    one_of,
    require,
)
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.compat import cell_nodes, coordinate_element
from qsdolfinx.remeshing.errors import RemeshError, on_root
from qsdolfinx.remeshing.features import Plane, find_features, planes_of_copy
from qsdolfinx.remeshing.fill import cell_quality, fill
from qsdolfinx.remeshing.intersections import check_simple
from qsdolfinx.remeshing.lattice import FromLattice, on_lattice
from qsdolfinx.remeshing.mmg import PROGRAMS, adapt, program
from qsdolfinx.remeshing.outline import Outline, boundary_facets, enclosed_volume, gather
from qsdolfinx.remeshing.respace import respace
from qsdolfinx.remeshing.restore import restore_volume
from qsdolfinx.remeshing.retriangulate import Boundary, retriangulate
from qsdolfinx.remeshing.sizes import Size, check_size, kinds, limit_growth, nodal_sizes, where
from qsdolfinx.surface.arguments import is_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Largest relative change of the volume by a new mesh. More would be seen as a change of pressure
#: in a nearly incompressible body.
VOLUME = 1e-4

#: Number of cells above which the sizes are probably a mistake, for example of units. A tenth of it
#: is a mesh that users solve with; with much more, memory ends before the message.
MOST_CELLS = 2e7

#: What makes meshes.
MESHERS = ("gmsh", "mmg")

#: The requested sizes are multiplied by each factor, one after the other, until there is a mesh
#: that is good enough. They must stay near 1: with 0.5, there would be eight times as many cells.
SIZES = (1.0, 0.85, 1.1, 0.7)

ANGLE = number("an angle between 0 and 180 degrees", lambda x: 0 < x < 180)
BODY = instance((mesh.Mesh, fem.Function), "a dolfinx.mesh.Mesh, or a displacement on it")
SIMPLICES = {2: mesh.CellType.triangle, 3: mesh.CellType.tetrahedron}


class RemeshReport(typing.NamedTuple):
    """Report of a remeshing.

    Attributes:
        volume: Volume of the old mesh (2D: area; axisymmetric: volume of the whole body).
        unrestored: Relative change of the volume with new nodes on the old boundary.
        volume_change: Relative change of the volume after the volume was restored.
        shift: Largest distance (length) by which nodes were moved to restore the volume.
        old_cells: Cells of the old mesh.
        num_cells: Cells of the new mesh.
        old_quality: Quality of the worst old cell, 1 is best: see ``MeshMotion.quality``.
        quality: Quality of the worst new cell.
    """

    volume: float
    unrestored: float
    volume_change: float
    shift: float
    old_cells: int
    num_cells: int
    old_quality: float
    quality: float

    def __str__(self) -> str:
        return (
            f"{self.old_cells} cells, the worst of quality {self.old_quality:.2g}, became "
            f"{self.num_cells}, the worst {self.quality:.2g}; the volume changed by "
            f"{self.volume_change:.1e} (before it was restored: {self.unrestored:.1e})"
        )


class Remeshed(typing.NamedTuple):
    """A new mesh of a body.

    Attributes:
        mesh: The mesh, distributed over all ranks.
        facet_tags: Tags of its boundary facets; facets with the tag 0 are left out.
        report: Report of the remeshing.
    """

    mesh: mesh.Mesh
    facet_tags: mesh.MeshTags
    report: RemeshReport


def remesh(
    body: mesh.Mesh | fem.Function,
    size: Size,
    facet_tags: mesh.MeshTags | None = None,
    *,
    axisymmetric: bool = False,
    feature_angle: float = 40.0,
    gradation: float | None = 0.5,
    min_quality: float | None = None,
    mesher: str = "gmsh",
    partitioner: typing.Any = None,
) -> Remeshed:
    """Make a new mesh of a body in its present configuration. Collective.

    Rank 0 alone makes the mesh: boundary and cells are gathered there, and the new mesh is
    distributed. The new mesh does not depend on the partition of the old mesh, or on errors of
    solvers in the positions of nodes: it is made for a copy of the body, with nodes rounded to less
    than a thousandth of the local cell size. New nodes are then mapped from the copy to the body.

    New boundary nodes are on the old boundary facets. Corners are kept. Edges with an angle of more
    than ``feature_angle`` between facets and borders between facet tags are kept, too: they get new
    nodes on the same lines. Plane parts stay exactly plane. Then all free boundary nodes move the
    same small distance along their normals to restore the volume. Free nodes are those on curved
    parts, but not on edges between two curved parts. gmsh makes the cells within the body; MMG
    makes boundary and cells.

    Args:
        body: Mesh of straight triangles in 2D or tetrahedra in 3D, in its present configuration; or
            a displacement on such a mesh: the new mesh is then that of the displaced body.
        size: Size of the new cells (length): a number, a function of points (3, n) that returns
            (n,), or a scalar Function on the old mesh; for a list of these the smallest. Sizes are
            evaluated at the old nodes and interpolated linearly. See
            :func:`qs.size_from_curvature`, :func:`qs.size_from_distance`,
            :func:`qs.size_from_field`.
        facet_tags: Tags of boundary facets, to be transferred.
        axisymmetric: Whether coordinates are (r, z): volumes are those of rings, and nodes on the
            axis stay on it.
        feature_angle: Angle of edges that are kept, in degrees.
        gradation: Largest growth of sizes per length; None for no limit.
        min_quality: Wanted quality of the worst cell, 1 at best (see ``MeshMotion.quality``): sizes
            of 0.7 to 1.1 times the given sizes are tried until it is reached; otherwise the best of
            these meshes is taken. None to take the first mesh.
        mesher: ``"gmsh"``; or ``"mmg"``, for tetrahedra: MMG's program ``mmg3d``, if installed,
            adapts boundary and cells, and its boundary nodes are then moved to the old facets.
        partitioner: Partitioner for ``dolfinx.mesh.create_mesh``; by default that of DOLFINx.

    Raises:
        RemeshError: If no valid mesh can be made, on all ranks, with the places that cause it;
            nothing is changed then.
        TypeError, ValueError: If an argument is of another type or out of range.
    """
    check(BODY, body=body)
    msh = body if isinstance(body, mesh.Mesh) else body.function_space.mesh
    with checked(msh.comm) as same:
        gdim = msh.geometry.dim
        fits = msh.topology.cell_type == SIMPLICES.get(gdim) and msh.topology.dim == gdim
        require(fits, "body: must be of triangles in 2D, or of tetrahedra in 3D")
        require(coordinate_element(msh).degree == 1, "body: the mesh must be of degree 1")
        check_size(msh, size)
        same(size=kinds(size))
        check(either(TAGS, None), facet_tags=facet_tags)
        same(facet_tags=None if facet_tags is None else "tags")
        if facet_tags is not None:
            of_facets = facet_tags.dim == gdim - 1 and is_of(facet_tags, msh)
            require(of_facets, "facet_tags: must be tags of facets of the body's mesh")
        same(FLAG, axisymmetric=axisymmetric)
        require(not axisymmetric or gdim == 2, "axisymmetric: needs a mesh in 2D, (r, z)")
        same(ANGLE, feature_angle=feature_angle)
        same(either(POSITIVE, None), gradation=gradation)
        same(either(FRACTION, None), min_quality=min_quality)
        same(one_of(MESHERS), mesher=mesher)
        check_mesher(msh, mesher)
    msh, x = where(body)
    with collective_errors(msh.comm):
        require(bool(np.isfinite(x).all()), "body: coordinates and displacements must be finite")
    turned = msh.comm.allreduce(_num_turned(msh, x), op=MPI.SUM)
    with collective_errors(msh.comm):
        require(turned == 0, f"body: the displacement turns {turned} cells inside out")
        rounding = ROUNDING * np.abs(x).max(initial=0.0)
        on_one_side = not axisymmetric or x[:, 0].min(initial=0.0) >= -rounding
        require(on_one_side, "axisymmetric: r, the first coordinate, must not be negative")
    outline = gather(msh, x, nodal_sizes(msh, x, size), facet_tags)

    def make() -> _Made:
        assert outline is not None
        graded = outline if gradation is None else limit_growth(outline, gradation)
        angle = float(np.radians(feature_angle))
        return _make(graded, _How(angle, axisymmetric, mesher), min_quality or 0.0)

    made = on_root(msh.comm, make)
    parts = None if made is None else (made.x, made.cells)
    new = distribute(msh.comm, msh.geometry.dim, parts, partitioner)
    boundary = None if made is None else made.boundary
    tags = tags_of(new, None if boundary is None else (boundary.facets, boundary.tags))
    if facet_tags is not None:
        new.name, tags.name = msh.name, facet_tags.name
    report = msh.comm.bcast(None if made is None else made.report, root=0)
    return Remeshed(new, tags, report)


def _num_turned(msh: mesh.Mesh, x: Array) -> int:
    """Number of cells of this rank that a displacement has inverted."""
    gdim, count = msh.geometry.dim, msh.topology.index_map(msh.topology.dim).size_local
    nodes = cell_nodes(msh)[:count]

    def signs(at: Array) -> Array:
        return np.sign(np.linalg.det((at[nodes[:, 1:]] - at[nodes[:, :1]])[..., :gdim]))

    before = np.asarray(msh.geometry.x, dtype=np.float64)
    return int(np.count_nonzero(signs(x) != signs(before)))


def check_mesher(msh: mesh.Mesh, mesher: str) -> None:
    """Raise an error if MMG is not installed, or the mesh consists of triangles.

    Raises:
        ValueError: If MMG cannot be used, with a remedy.
    """
    if mesher != "mmg":
        return
    require(msh.geometry.dim == 3, 'mesher: "mmg" makes tetrahedra; take "gmsh" in 2D')
    names = " or ".join(PROGRAMS)
    there = msh.comm.rank != 0 or program() is not None
    require(
        there,
        f'mesher: "mmg" needs {names} on the PATH of rank 0; install MMG, or take "gmsh"; '
        "the Python package mmgpy has it, too",
    )


class _How(typing.NamedTuple):
    """Settings of a mesh: angle of features (radians), whether axisymmetric (r, z), mesher."""

    angle: float
    axisymmetric: bool
    mesher: str


class _Made(typing.NamedTuple):
    """Mesh created by rank 0.

    Attributes:
        x: Nodes, boundary nodes first.
        cells: Cells.
        boundary: The boundary.
        report: Report of the changes.
    """

    x: Array
    cells: Indices
    boundary: Boundary
    report: RemeshReport


def _make(outline: Outline, how: _How, wanted: float) -> _Made:
    """Create the mesh on one rank; if its quality is too low, with slightly different sizes."""
    _check_outline(outline)
    _check_number(outline)
    problems: list[RemeshError] = []
    made: list[_Made] = []
    for factor in SIZES:
        try:
            given = outline._replace(sizes=factor * outline.sizes)
            made.append(_make_of(*on_lattice(given), how))
        except RemeshError as error:
            problems.append(error)
            continue
        if made[-1].report.quality >= wanted:
            break
    if not made:
        raise problems[0]
    return max(made, key=lambda mesh: mesh.report.quality)


def _make_of(outline: Outline, copy: Outline, how: _How) -> _Made:
    """Mesh the copy of a body on a lattice, and map the new nodes to the body."""
    axisymmetric, inside = how.axisymmetric, None
    volume = enclosed_volume(outline.x, outline.facets, axisymmetric)
    planes: dict[int, Plane] = {}
    if outline.gdim == 2:
        new = respace(outline, copy, how.angle, axisymmetric)
    else:
        surface = copy.x, copy.facets, copy.tags, copy.sizes
        features = find_features(outline.x, *surface[1:], how.angle)
        planes = planes_of_copy(features, copy.x, copy.facets)
        if how.mesher == "mmg":
            new, inside = adapt(copy, features)
        else:
            new = retriangulate(*surface, features)
    into_body = FromLattice(outline, copy)
    boundary = new.at(into_body(new.x), new.planes)
    unrestored = enclosed_volume(boundary.x, boundary.facets, axisymmetric) / volume - 1
    shift = restore_volume(boundary, volume, axisymmetric)
    check_simple(boundary.x, boundary.facets)
    change = enclosed_volume(boundary.x, boundary.facets, axisymmetric) / volume - 1
    if abs(change) > VOLUME:
        raise RemeshError.at(
            f"the volume would change by {change:.2g}, since no boundary node is free to restore "
            "it: ask for smaller cells; the body is",
            outline.x.mean(axis=0),
        )
    if inside is None:
        new = new.at(new.x, planes)
        restore_volume(new, enclosed_volume(copy.x, copy.facets, axisymmetric), axisymmetric)
        inside = fill(new, copy)
    x, cells = inside.within(boundary, into_body)
    _check_filled(x, cells, enclosed_volume(boundary.x, boundary.facets))
    report = RemeshReport(
        volume,
        unrestored,
        change,
        shift,
        len(outline.cells),
        len(cells),
        float(cell_quality(outline.x, outline.cells).min()),
        float(cell_quality(x, cells).min()),
    )
    return _Made(x, cells, boundary, report)


def _check_filled(x: Array, cells: Indices, enclosed: float) -> None:
    """Raise an error for cells that do not fill the body, or fill a void."""
    gdim = cells.shape[1] - 1
    edges = (x[cells[:, 1:]] - x[cells[:, :1]])[..., :gdim]
    filled = float(np.abs(np.linalg.det(edges)).sum()) / (2.0 if gdim == 2 else 6.0)
    if abs(filled / enclosed - 1) > SOLVED:
        raise RemeshError.at(
            f"the cells fill {filled / enclosed:.6g} of the volume in the boundary; the body is",
            x.mean(axis=0),
        )


def _check_number(outline: Outline) -> None:
    """Raise an error for sizes that would give too many cells."""
    gdim, corners = outline.gdim, outline.x[outline.cells]
    volumes = np.abs(np.linalg.det((corners[:, 1:] - corners[:, :1])[..., :gdim]))
    of_sizes = outline.sizes[outline.cells].mean(axis=1) ** gdim
    number = float(np.sum(volumes / of_sizes))
    if number > MOST_CELLS:
        raise RemeshError(
            f"size: would give about {number:.1g} cells; it is a length in the units of the mesh",
            outline.x.mean(axis=0)[None],
        )


def _check_outline(outline: Outline) -> None:
    """Raise an error for a body with coordinates that are not finite, or intersecting itself."""
    bad = ~np.isfinite(outline.x).all(axis=1)
    if bad.any():
        raise RemeshError(f"body: {bad.sum()} nodes have coordinates that are not finite")
    check_simple(outline.x, outline.facets)


def distribute(
    comm: MPI.Intracomm,
    gdim: int,
    made: tuple[Array, Indices] | None,
    partitioner: typing.Any = None,
) -> mesh.Mesh:
    """Distribute a mesh of simplices over all ranks. Collective.

    Args:
        comm: Communicator.
        gdim: Geometric dimension.
        made: Coordinates, shape (nodes, 3), and nodes of the cells, on rank 0.
        partitioner: See :func:`qs.remesh`.
    """
    none = np.zeros((0, gdim)), np.zeros((0, gdim + 1), dtype=np.int64)
    x, cells = none if made is None else (made[0][:, :gdim], made[1])
    element = basix.ufl.element("Lagrange", SIMPLICES[gdim].name, 1, shape=(gdim,))
    return mesh.create_mesh(
        comm,
        cells=np.ascontiguousarray(cells),
        x=np.ascontiguousarray(x),
        e=ufl.Mesh(element),
        partitioner=partitioner,
    )


def tags_of(msh: mesh.Mesh, boundary: tuple[Indices, Indices] | None) -> mesh.MeshTags:
    """Facet tags, given the node numbers of the facets on rank 0. Collective.

    Args:
        msh: The mesh.
        boundary: Facets, shape (facets, gdim), and their tags, on rank 0; 0 means no tag.
    """
    mine = None if boundary is None else (np.sort(boundary[0], axis=1), boundary[1])
    known, values = msh.comm.bcast(mine, root=0)
    facets, nodes = boundary_facets(msh)
    keys = np.sort(np.asarray(msh.geometry.input_global_indices)[nodes[:, :-1]], axis=1)
    number = np.unique(np.vstack([known, keys]), axis=0, return_inverse=True)[1].ravel()
    of_number = np.zeros(int(number.max(initial=0)) + 1, dtype=np.int64)
    of_number[number[: len(known)]] = values
    found = of_number[number[len(known) :]]
    order = np.argsort(facets)
    order = order[found[order] != 0]
    return mesh.meshtags(
        msh, msh.topology.dim - 1, facets[order].astype(np.int32), found[order].astype(np.int32)
    )
