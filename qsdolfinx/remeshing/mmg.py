"""Adapt tetrahedra to sizes by MMG, called as an external program."""

from __future__ import annotations

import importlib.metadata
import os
import pathlib
import shutil
import subprocess
import tempfile
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.features import Features
from qsdolfinx.remeshing.fill import Inside, signed_sizes
from qsdolfinx.remeshing.outline import Outline, listed, outward
from qsdolfinx.remeshing.reference import OldSurface
from qsdolfinx.remeshing.retriangulate import Boundary, boundary_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Names of the program.
PROGRAMS = ("mmg3d_O3", "mmg3d")

#: First lines of the files.
HEAD = "MeshVersionFormatted 2\nDimension 3\n"

#: Sections that are read from a file, with the numbers per row.
SECTIONS = {"Vertices": 4, "Tetrahedra": 5, "Triangles": 4, "Edges": 3}


#: The Python package that contains the program.
PACKAGE = "mmgpy"


def program() -> str | None:
    """Path of MMG's program, on the PATH or in the Python package; None if it is not found.

    The program runs in its own process: if MMG crashes, the run continues.
    """
    return next(filter(None, map(shutil.which, PROGRAMS)), None) or _of_package()


def _of_package() -> str | None:
    """Path of the compiled program in ``mmgpy``, in any environment on Python's path."""
    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    paths = (str(f.locate()) for f in files if f.name in PROGRAMS and f.parts[0] == PACKAGE)
    return next((path for path in paths if os.access(path, os.X_OK)), None)


def adapt(outline: Outline, features: Features) -> tuple[Boundary, Inside]:
    """Adapt the cells of a body by MMG; new boundary nodes are projected onto the old facets.

    Args:
        outline: The body.
        features: Features of its boundary that are kept.

    Raises:
        RemeshError: If MMG fails, or has lost a part of the boundary.
    """
    found = _run(outline, features)
    x, cells = found["Vertices"][:, :3], _numbers(found["Tetrahedra"])[:, :4]
    facets, region = _facets(x, cells, _numbers(found["Triangles"], 4))
    edges = _numbers(found.get("Edges", np.zeros((0, 3))), 3)
    # Nodes of the boundary first.
    first = np.unique(facets)
    nodes = np.concatenate([first, np.setdiff1d(np.unique(cells), first)])
    number = np.full(len(x), -1)
    number[nodes] = np.arange(len(nodes))
    x, cells, facets = x[nodes], number[cells], number[facets]
    of_boundary = x[: len(first)].copy()
    used = (number[edges[:, :2]] >= 0).all(axis=1)
    lines = np.hstack([number[edges[used, :2]], edges[used, 2:]])
    corner, sizes = _onto_old(of_boundary, facets, region, lines, outline, features)
    tag_of = dict(zip(listed(features.region), listed(outline.tags), strict=True))
    boundary = boundary_of(of_boundary, facets, region, corner, sizes, features, tag_of)
    return boundary, Inside(x, cells)


def _run(outline: Outline, features: Features) -> dict[str, Array]:
    """Call MMG; returns the sections of its output file."""
    name = program()
    if name is None:
        raise RemeshError(f"mesher: none of {', '.join(PROGRAMS)} is on the PATH of rank 0")
    sizes = outline.sizes
    with tempfile.TemporaryDirectory(prefix="qsdolfinx-") as folder:
        given, wanted, made = (pathlib.Path(folder) / f for f in ("in.mesh", "in.sol", "out.mesh"))
        _write(given, outline, features)
        _write_sizes(wanted, sizes)
        # Lines, corners, growth and surface sizes are given: MMG must not determine them. Its
        # surface is at most a tenth of a size off the smooth surface.
        options = ["-v", "1", "-nr", "-hgrad", "-1", "-hausd", f"{0.1 * sizes.max():.17g}"]
        limits = ["-hmin", f"{sizes.min() / 4:.17g}", "-hmax", f"{2 * sizes.max():.17g}"]
        files = ["-sol", str(wanted), "-out", str(made), str(given)]
        done = subprocess.run(
            [name, *options, *limits, *files],
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
        )
        if done.returncode != 0 or not made.exists():
            said = [line.strip() for line in (done.stderr + done.stdout).splitlines()]
            errors = [line for line in said if "rror" in line] or [line for line in said if line]
            text = f"MMG has failed ({done.returncode}): {' '.join(errors[:2])}"
            raise RemeshError(text, outline.x.mean(axis=0)[None])
        return _read(made)


def _write(path: pathlib.Path, outline: Outline, features: Features) -> None:
    """Write a body in the format of Medit: regions and lines are references."""
    corners = np.array(sorted(features.corners), dtype=np.int64)
    lines = np.array([(*edge, line + 1) for edge, line in sorted(features.lines.items())])
    lines = lines.reshape(-1, 3).astype(np.int64)
    numbers = np.arange(1, len(lines) + 1)
    cells = outline.cells.copy()
    left = signed_sizes(outline.x, cells) < 0
    cells[left, 2:] = cells[left, :1:-1]
    zero = np.zeros((len(cells), 1), dtype=np.int64)
    region = features.region[:, None]
    with path.open("wb") as file:
        file.write(f"{HEAD}Vertices\n{len(outline.x)}\n".encode())
        np.savetxt(file, outline.x, fmt="%.17g %.17g %.17g 0")
        _write_rows(file, "Tetrahedra", np.hstack([cells + 1, zero]))
        _write_rows(file, "Triangles", np.hstack([outline.facets, region]) + 1)
        _write_rows(file, "Edges", lines + np.array([1, 1, 0]))
        _write_rows(file, "Ridges", numbers[:, None])
        _write_rows(file, "Corners", corners[:, None] + 1)
        _write_rows(file, "RequiredVertices", corners[:, None] + 1)
        file.write(b"End\n")


def _write_rows(file: typing.BinaryIO, name: str, rows: Indices) -> None:
    if len(rows):
        file.write(f"{name}\n{len(rows)}\n".encode())
        np.savetxt(file, rows, fmt="%d")


def _write_sizes(path: pathlib.Path, sizes: Array) -> None:
    with path.open("wb") as file:
        file.write(f"{HEAD}SolAtVertices\n{len(sizes)}\n1 1\n".encode())
        np.savetxt(file, sizes, fmt="%.17g")
        file.write(b"End\n")


def _read(path: pathlib.Path) -> dict[str, Array]:
    """Read the sections of a file, by name."""
    words = path.read_text().split()
    out: dict[str, Array] = {}
    for name, width in SECTIONS.items():
        if name not in words:
            continue
        at = words.index(name) + 1
        try:
            count = int(words[at])
            rows = np.array(words[at + 1 : at + 1 + width * count], dtype=np.float64)
            out[name] = rows.reshape(count, width)
        except (IndexError, ValueError) as error:
            raise RemeshError(f"MMG has written {name} that are not complete") from error
    if not {"Vertices", "Tetrahedra", "Triangles"} <= out.keys():
        raise RemeshError("MMG has written no tetrahedra, or no triangles")
    return out


def _numbers(rows: Array, width: int = 5) -> Indices:
    """Rows of node numbers from 0, and a reference."""
    return np.asarray(rows.astype(np.int64) - 1).reshape(-1, width)


def _facets(x: Array, cells: Indices, triangles: Indices) -> tuple[Indices, Indices]:
    """Outward boundary facets of cells, and the regions of the corresponding triangles."""
    faces = np.concatenate([np.delete(cells, i, axis=1) for i in range(4)])
    opposite = np.concatenate([cells[:, i] for i in range(4)])
    keys = np.sort(faces, axis=1)
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    once = first[count == 1]
    known = np.sort(triangles[:, :3], axis=1)
    both, number = np.unique(np.vstack([known, keys[once]]), axis=0, return_inverse=True)
    of = np.full(len(both), -1)
    of[number.ravel()[: len(known)]] = triangles[:, 3]
    region = of[number.ravel()[len(known) :]]
    if (region < 0).any():
        at = x[keys[once][region < 0]].mean(axis=1)
        raise RemeshError.at("MMG has lost parts of the boundary", at)
    return outward(x, keys[once], opposite[once]), region


def _onto_old(
    x: Array, facets: Indices, region: Indices, lines: Indices, outline: Outline, features: Features
) -> tuple[npt.NDArray[np.bool_], Array]:
    """Project boundary nodes onto the old facets.

    Args:
        x: Coordinates of the nodes, changed in place, shape (nodes, 3).
        facets: Shape (triangles, 3).
        region: Their regions, shape (triangles,).
        lines: Nodes of edges on lines, and the number of the line, shape (edges, 3).
        outline: The old body.
        features: What is kept.

    Returns:
        Flags of corner nodes, and requested sizes at the nodes, both of shape (nodes,).
    """
    old = OldSurface(outline.x, outline.facets, outline.sizes, features)
    sizes, corner, on_line = np.zeros(len(x)), np.zeros(len(x), dtype=bool), np.full(len(x), -1)
    of_node = np.full(len(x), -1)
    of_node[facets.ravel()] = np.repeat(region, 3)
    on_line[lines[:, :2].ravel()] = np.repeat(lines[:, 2], 2)
    for node in sorted(features.corners):
        place = outline.x[node]
        nearest = int(np.argmin(np.linalg.norm(x - place, axis=1)))
        x[nearest], sizes[nearest], corner[nearest] = place, outline.sizes[node], True
    for number in np.unique(on_line[(on_line >= 0) & ~corner]):
        nodes = np.flatnonzero((on_line == number) & ~corner)
        x[nodes], sizes[nodes] = old.onto_line(int(number), x[nodes])
    free = (on_line < 0) & ~corner
    for number in np.unique(of_node[free]):
        nodes = np.flatnonzero(free & (of_node == number))
        x[nodes], sizes[nodes] = old.onto_region(int(number), x[nodes])[:2]
    return corner, sizes
