"""Read triangles of STL files; incomplete files are rejected."""

from __future__ import annotations

import os
import re
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require
from qsdolfinx.tools.triangulation import without_area

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Bytes of a binary file before its triangles: header and count.
_START = 84

_RECORD = np.dtype([("normal", "<f4", 3), ("x", "<f4", (3, 3)), ("attribute", "<u2")])

#: Characters that may follow the content of a file: blanks, padding, the DOS end-of-file mark.
_BLANK = b" \t\r\n\v\f\0\x1a"

_SOLID = re.compile(rb"^[ \t]*(end ?)?solid[^\n]*$", re.IGNORECASE | re.MULTILINE)

#: Words of a facet in an ASCII file; None for a number.
_FACET: tuple[bytes | None, ...] = (
    *(b"facet", b"normal", None, None, None, b"outer", b"loop"),
    *(b"vertex", None, None, None) * 3,
    *(b"endloop", b"endfacet"),
)

#: Positions of the coordinates among these words.
_NUMBERS = [i for i, word in enumerate(_FACET) if word is None and i > 4]


class Stl(typing.NamedTuple):
    """Content of an STL file.

    Attributes:
        x: Vertices, shape (vertices, 3).
        triangles: Indices of the vertices of each triangle that has an area, shape (triangles, 3).
        num_dropped: Number of triangles without area, which are left out.
        num_opened: Number of edges that have lost a neighbour because of this.
    """

    x: Array
    triangles: Indices
    num_dropped: int
    num_opened: int

    @property
    def advice(self) -> str:
        """Warning text, or an empty string."""
        if self.num_dropped == 0:
            return ""
        text = f"filename: {self.num_dropped} triangles have no area and are left out"
        if self.num_opened:
            text += (
                f"; {self.num_opened} edges have no neighbour any more, and nodes there may find "
                "no partner: repair the surface in the program that wrote it"
            )
        return text


def read_stl(filename: str | os.PathLike[str]) -> Stl:
    """Read an STL file, ASCII or binary; vertices with equal coordinates are merged.

    Raises:
        ValueError: If the file cannot be read, is not an STL file, or is incomplete.
    """
    try:
        with open(filename, "rb") as file:
            data = file.read()
    except (OSError, TypeError) as error:
        raise ValueError(f"filename: cannot be read: {error}") from error
    name = f"filename: {os.fspath(filename)!r}"
    corners = _of_text(name, data) if _is_text(data) else _of_binary(name, data)
    require(len(corners), f"{name} is no STL file with triangles")
    finite = bool(np.isfinite(corners).all())
    require(finite, f"{name} has coordinates that are not finite (NaN, infinity)")
    x, index = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int64)
    flat = without_area(x[triangles])
    kept = triangles[~flat]
    require(len(kept), f"{name} is no STL file with triangles: none of them has an area")
    return Stl(x, kept, int(np.count_nonzero(flat)), _num_opened(triangles, flat))


def _num_opened(triangles: Indices, flat: npt.NDArray[np.bool_]) -> int:
    """Number of edges that lose their neighbour when flat triangles are left out."""
    if not flat.any():
        return 0
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    edges[edges[..., 0] == edges[..., 1]] = -1  # a point
    found, index = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    index = index.reshape(-1, 3)
    before = np.bincount(index.ravel(), minlength=len(found))
    after = np.bincount(index[~flat].ravel(), minlength=len(found))
    return int(np.count_nonzero((before > 1) & (after == 1)))


# --- Binary files


def _is_text(data: bytes) -> bool:
    """Whether a file is ASCII.

    The header of a binary file may begin with "solid" as well. Then the file size agrees with its
    count, or the count has a zero byte, as all counts below 2²⁴ do.
    """
    text = data.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:5].lower() != b"solid":
        return False
    return len(data) < _START or (0 not in data[80:_START] and _size(data) != len(data))


def _size(data: bytes) -> int:
    """Size of a binary file according to its count, bytes."""
    return _START + _RECORD.itemsize * int.from_bytes(data[80:_START], "little")


def _of_binary(name: str, data: bytes) -> Array:
    """Corners, shape (triangles, 3, 3): 80 bytes of header, a count, 50 bytes per triangle."""
    if len(data) < _START:
        raise ValueError(f"{name} is no STL file with triangles, or truncated in its header")
    count = int.from_bytes(data[80:_START], "little")
    fits = (len(data) - _START) // _RECORD.itemsize
    require(
        count <= fits,
        f"{name} is truncated, or no STL file: its header says {count} triangles, its size is that "
        f"of {fits} triangles",
    )
    rest = data[_size(data) :]
    require(
        len(rest) < _RECORD.itemsize or not rest.strip(_BLANK),
        f"{name} has more than its header says: {count} triangles, its size is that of {fits}",
    )
    return np.frombuffer(data, _RECORD, count, _START)["x"].astype(np.float64)


# --- Text


def _of_text(name: str, data: bytes) -> Array:
    """Corners, shape (triangles, 3, 3), of all solids of a file."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n").rstrip(_BLANK)
    ends = [*_SOLID.finditer(text)]
    closed = len(ends) % 2 == 0 and all(
        (match.group(1) is None) == (i % 2 == 0) for i, match in enumerate(ends)
    )
    require(
        closed,
        f'{name} is truncated, or no STL file: each "solid" needs a line "endsolid" after it',
    )
    starts = [0, *(match.end() for match in ends)]
    pieces = [
        text[start:stop]
        for start, stop in zip(starts, [*(m.start() for m in ends), len(text)], strict=True)
    ]
    if any(piece.strip() for piece in pieces[::2]):
        raise ValueError(f'{name} is no STL file: there is more outside of "solid" … "endsolid"')
    return np.concatenate([np.zeros((0, 3, 3)), *(_facets(name, p) for p in pieces[1::2])])


def _facets(name: str, piece: bytes) -> Array:
    """Corners of the facets of a solid; every facet has the same number of words."""
    words = piece.lower().split()
    width = len(_FACET)
    whole = len(words) % width == 0 and all(
        words[i::width].count(word) == len(words) // width
        for i, word in enumerate(_FACET)
        if word is not None
    )
    broken = f"{name} is truncated, or no STL file: after {{}} facets a facet is not complete"
    if not whole:
        raise ValueError(broken.format(_num_whole(words)))
    numbers = [words[i::width] for i in _NUMBERS]
    # Neither character is part of a number in STL, although Python may accept it.
    clean = b"_" not in piece and b"\0" not in piece
    require(clean, f"{name} is no STL file: a coordinate is no number")
    try:
        values = np.array([[float(word) for word in column] for column in numbers])
    except ValueError as error:
        raise ValueError(f"{name} is no STL file: a coordinate is no number: {error}") from error
    return np.ascontiguousarray(values.T).reshape(-1, 3, 3)


def _num_whole(words: list[bytes]) -> int:
    """Number of facets before the first incomplete one."""
    width = len(_FACET)
    for count in range(len(words) // width):
        facet = words[count * width : (count + 1) * width]
        if any(w is not None and w != f for w, f in zip(_FACET, facet, strict=True)):
            return count
    return len(words) // width
