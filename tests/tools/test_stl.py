"""STL files: valid files are read; truncated or damaged files are refused, never read in part."""

import pathlib

import numpy as np
import pytest
from contact.test_warnings import warned
from rigid_scenes import write_stl
from scenes import WORLD, raises_everywhere

import qsdolfinx as qs
from qsdolfinx.tools.stl import read_stl
from qsdolfinx.tools.touching import components, separate

#: A tetrahedron with outward facets.
X = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("stl")), root=0))


@pytest.fixture
def scratch(tmp_path):
    """A separate file for each rank."""
    return tmp_path / f"{WORLD.rank}.stl"


def content(scratch, binary, corners=X[TRIANGLES]):
    write_stl(scratch, corners, binary)
    return scratch.read_bytes()


def read(scratch, data):
    scratch.write_bytes(data)
    return read_stl(scratch)


def corners_of(stl):
    """Corners sorted, independent of the order in the file."""
    x = stl.x[stl.triangles]
    first = [int(np.lexsort(corner.T[::-1])[0]) for corner in x]
    turned = np.array([np.roll(c, -i, axis=0) for c, i in zip(x, first, strict=True)])
    return turned[np.lexsort(turned.reshape(len(x), -1).T)]


TEXTS = {
    "as it is": lambda text: text,
    "upper case": bytes.upper,
    "mixed case": bytes.title,
    "BOM": lambda text: b"\xef\xbb\xbf" + text,
    "CRLF": lambda text: text.replace(b"\n", b"\r\n"),
    "CR": lambda text: text.replace(b"\n", b"\r"),
    "trailing": lambda text: text + b"\n \t\n\n\0\0\x1a",
    "leading": lambda text: b"\n  \n" + text,
    "no name": lambda text: text.replace(b"solid tool", b"solid"),
    "another name": lambda text: text.replace(b"solid tool", b"solid Ges\xe4nk 2\xbd"),
    "no number as normal": lambda text: text.replace(b"normal 0 0 0", b"normal -nan(ind) nan inf"),
    "few lines": lambda text: text.replace(b"\n      ", b" ").replace(b"\n    end", b" end"),
}


@pytest.mark.parametrize("variant", TEXTS)
def test_texts(scratch, variant):
    changed = TEXTS[variant](content(scratch, False))
    assert (changed == content(scratch, False)) == (variant == "as it is")
    found = read(scratch, changed)
    np.testing.assert_array_equal(found.x, X[np.lexsort(X.T[::-1])])
    known = read(scratch, content(scratch, False))
    np.testing.assert_array_equal(corners_of(found), corners_of(known))
    assert found.advice == ""


def test_several_solids(scratch):
    parts = [content(scratch, False, X[TRIANGLES[i : i + 2]]) for i in (0, 2)]
    for between in (b"", b"\n\n", b"solid empty\nendsolid empty\n"):
        found = read(scratch, between.join(parts))
        known = read(scratch, content(scratch, False))
        np.testing.assert_array_equal(corners_of(found), corners_of(known))


def test_binary(scratch):
    """Binary files may have a header like that of a text file, and data after the triangles."""
    data = content(scratch, True)
    known = corners_of(read(scratch, data))
    np.testing.assert_array_equal(known, corners_of(read(scratch, content(scratch, False))))
    for header in (b"solid tool", b"SOLID facet normal 0 0 0", b"\xef\xbb\xbfsolid"):
        for end in (b"", b"\r\n", b"\0" * 400, b"end of the file"):
            found = read(scratch, header.ljust(80) + data[80:] + end)
            np.testing.assert_array_equal(corners_of(found), known)


def test_truncated(scratch):
    """A file truncated at any byte is refused, or all its facets are read."""
    for binary in (False, True):
        for header in (b"tool", b"solid"):
            data = content(scratch, binary)
            if binary:
                data = header.ljust(80) + data[80:]
            for length in range(len(data)):
                scratch.write_bytes(data[:length])
                try:
                    found = read_stl(scratch)
                except ValueError as error:
                    assert "truncated" in str(error), (length, error)
                    continue
                assert len(found.triangles) == len(TRIANGLES), length
                assert not binary and b"endsolid" in data[:length]


@pytest.mark.parametrize("binary", (False, True))
def test_flipped_bytes(scratch, binary):
    """Changed bytes may change numbers, but a lost facet always gives an exception."""
    data, rng = content(scratch, binary), np.random.default_rng(11)
    outcomes = set()
    for i in range(2000):
        changed = bytearray(data)
        for at in rng.integers(len(data), size=1 + i % 2):
            changed[at] = rng.integers(256) if i % 4 < 2 else changed[at] ^ (1 << rng.integers(8))
        try:
            found = read(scratch, bytes(changed))
        except ValueError as error:
            assert str(error).startswith("filename: ")
            outcomes.add("refused")
            continue
        assert len(found.triangles) + found.num_dropped == len(TRIANGLES), bytes(changed)
        outcomes.add("read")
    assert outcomes == {"refused", "read"}


def test_cut_lines_and_records(scratch):
    """A missing or repeated line or record is refused."""
    lines = content(scratch, False).splitlines(keepends=True)
    for i in range(len(lines)):
        for changed in (lines[:i] + lines[i + 1 :], lines[: i + 1] + lines[i:]):
            scratch.write_bytes(b"".join(changed))
            with pytest.raises(ValueError, match=r"truncated|no STL file"):
                read_stl(scratch)
    data = content(scratch, True)
    for changed in (data[:134] + data[184:], data[:134] + data[84:]):
        scratch.write_bytes(changed)
        with pytest.raises(ValueError, match=r"header says:? 4 triangles, its size is that"):
            read_stl(scratch)


@pytest.mark.parametrize(
    "number", (b"nan", b"inf", b"1e999", b"1_0", b"1,5", b"0x1", b"1\x002", b"--1")
)
def test_what_is_no_number(scratch, number):
    data = content(scratch, False).replace(b"vertex 1.0", b"vertex " + number, 1)
    scratch.write_bytes(data)
    with pytest.raises(ValueError, match=r"^filename: .*(no number|not finite)"):
        read_stl(scratch)


def test_without_area(folder):
    """Triangles without area are skipped with a warning on all ranks.

    The warning says whether a crack opens by that.
    """
    middle = (X[1] + X[2]) / 2
    point, needle = X[[0, 0, 0]], X[[1, 3, 3]]
    whole = X[TRIANGLES]
    # One facet is split in two, its neighbour at the edge 1 2 is not: a flat triangle fills the
    # gap.
    split = np.array([[X[0], X[2], middle], [X[0], middle, X[1]], *whole[1:], X[[2, 1, 1]]])
    split[-1] = X[1], middle, X[2]
    for binary in (False, True):
        for name, corners, dropped, opened in (
            ("needles", [*whole, point, needle], 2, False),
            ("flat", split, 1, True),
            ("open", [*whole[:2], point], 1, False),  # edges that never had a neighbour
        ):
            file = folder / f"{name}{binary}.stl"
            if WORLD.rank == 0:
                write_stl(file, np.array(corners), binary)
            WORLD.barrier()
            tools = []
            texts = warned(lambda f=file, t=tools: t.append(qs.RigidSurface.from_stl(WORLD, f)))
            assert len(texts) == 1 and f"{dropped} triangle" in texts[0], texts
            assert ("no neighbour" in texts[0]) == opened
            assert WORLD.allreduce(tools[0].facets().facet_x.shape[0]) == len(corners) - dropped
    file = folder / "none.stl"
    if WORLD.rank == 0:
        write_stl(file, np.array([point, needle]), True)
    WORLD.barrier()
    call = lambda: qs.RigidSurface.from_stl(WORLD, file)  # noqa: E731
    raises_everywhere(WORLD, ValueError, "no STL file with triangles", call)


def brick(low, high):
    """Corners of the outward triangles of a box, shape (12, 3, 3)."""
    x = np.array([[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
                  for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return x[[[s[0], *pair] for s in sides for pair in ((s[1], s[2]), (s[2], s[3]))]]


#: Boxes that share walls and edges, by their corners.
TOUCHING = {
    "wall": [([0, 0, 0], [1, 1, 1]), ([1, 0, 0], [2.5, 1, 1])],
    "edge": [([0, 0, 0], [1, 1, 1]), ([1, 1, 0], [2, 2, 1])],
    "four around an edge": [([i, j, 0], [i + 1, j + 1, 1]) for i in (0.0, 1.0) for j in (0.0, 1.0)],
}


@pytest.mark.parametrize("scene", TOUCHING)
def test_solids_that_touch(folder, scene):
    """Each solid of a file is a separate shell, for any position of the file in space."""
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [[1, 0, 0], [0, c, -s], [0, s, c]]
    corners = np.concatenate([brick(low, high) for low, high in TOUCHING[scene]]) @ turn.T + 2.7
    if WORLD.rank == 0:
        write_stl(folder / "touching.stl", corners, True)
    WORLD.barrier()
    qs.RigidSurface.from_stl(WORLD, folder / "touching.stl")
    stl = read_stl(folder / "touching.stl")
    x, triangles = separate(stl.x, stl.triangles)
    np.testing.assert_array_equal(x[triangles], stl.x[stl.triangles])
    shells = components(triangles, len(x))[triangles]
    assert np.all(shells == shells[:, :1])
    assert np.unique(shells[:, 0], return_counts=True)[1].tolist() == [12] * len(TOUCHING[scene])


def test_wrong_orientation_says_where(folder):
    """The error names the place where triangles do not form solids, or occur twice."""
    turned = X[TRIANGLES].copy()
    turned[0] = turned[0][::-1]
    for corners in (turned, np.concatenate([X[TRIANGLES], X[TRIANGLES]])):
        if WORLD.rank == 0:
            write_stl(folder / "turned.stl", corners, False)
        WORLD.barrier()
        raises_everywhere(
            WORLD,
            ValueError,
            "turned.stl': neighbours at the edge from (0, 0, 0) to (",
            lambda: qs.RigidSurface.from_stl(WORLD, folder / "turned.stl"),
        )
