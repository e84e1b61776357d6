"""Files for ParaView, and the table of a run."""

import builtins
import csv
import pathlib
import resource
import sys
import xml.etree.ElementTree

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, box, raises_everywhere, vector_space
from step_scenes import Upset

import ufl
from dolfinx import fem, io

import qsdolfinx as qs

TIMES = (0.5, 1.25)


@pytest.fixture
def folder(tmp_path_factory):
    """A folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("out")), root=0))


def write(filename, **more):
    """Write fields on a mesh that moves by t (y, 0): u = t x and its divergence."""
    msh = box(WORLD, (3, 2), "triangle", [0.0, 0.0], [1.0, 1.0])
    x0 = msh.geometry.x.copy()
    u = fem.Function(vector_space(msh), name="other")
    writer = qs.FieldWriter(filename, msh, {"u": u, "div": ufl.div(u)} | more)
    for t in TIMES:
        u.interpolate(lambda x, t=t: t * x[:2])
        msh.geometry.x[:, 0] = x0[:, 0] + t * x0[:, 1]
        writer.write(t)
    writer.close()
    WORLD.barrier()


def grids(filename):
    """Names and times of the fields in an XDMF file."""
    found = {}
    for grid in xml.etree.ElementTree.parse(filename).iter("Grid"):
        if grid.get("GridType") == "Collection":
            found[grid.get("Name")] = [float(t.get("Value")) for t in grid.iter("Time")]
    return found


def dataset(filename, name):
    """Sorted values of a dataset, on every rank."""
    return np.sort(stored(filename, name))


def stored(filename, name):
    """Values of a dataset in the order of the file, on every rank."""
    viewer = PETSc.ViewerHDF5().create(str(filename), "r", comm=WORLD)
    group, _, last = name.rpartition("/")
    viewer.pushGroup(group)
    vec = PETSc.Vec().create(comm=WORLD)
    vec.setName(last)
    vec.load(viewer)
    viewer.popGroup()
    viewer.destroy()
    return np.concatenate(WORLD.allgather(vec.array_r))


def test_xdmf(folder):
    write(folder / "fields.xdmf")
    assert grids(folder / "fields.xdmf") == {k: list(TIMES) for k in ("displacement", "u", "div")}
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 3)))
    for t, name in zip(TIMES, ("0_5", "1_25"), strict=True):
        # The second field was interpolated on the mesh at the first time, or undeformed.
        div = dataset(folder / "fields.h5", f"/Function/div/{name}")
        assert len(div) == 12 and np.all(np.isfinite(div))
        moved = dataset(folder / "fields.h5", f"/Function/displacement/{name}")
        expected = np.sort(np.concatenate([t * y, np.zeros(24)]))
        np.testing.assert_allclose(moved, expected, atol=1e-14)
    u = dataset(folder / "fields.h5", "/Function/u/0_5")
    np.testing.assert_allclose(
        u, np.sort(np.concatenate([0.5 * x, 0.5 * y, np.zeros(12)])), atol=1e-15
    )


def test_own_displacement(folder):
    """The displacement of a displacement-based body replaces that of the mesh."""
    msh = box(WORLD, (2, 2), "triangle", [0.0, 0.0], [1.0, 1.0])
    u = fem.Function(vector_space(msh))
    u.interpolate(lambda x: 2 + x[:2])
    writer = qs.FieldWriter(folder / "die.xdmf", msh, {"displacement": u})
    writer.write(0.5)
    writer.close()
    assert grids(folder / "die.xdmf") == {"displacement": [0.5]}
    assert np.isclose(dataset(folder / "die.h5", "/Function/displacement/0_5").max(), 3.0)


@pytest.mark.skipif(not hasattr(io, "VTXWriter"), reason="DOLFINx without ADIOS2")
def test_vtx(folder):
    write(folder / "fields.bp")
    assert (folder / "fields.bp").exists() and (folder / "fields_cells.bp").exists()


def test_bad_names(folder, monkeypatch):
    raises_everywhere(WORLD, ValueError, ".xdmf, .pvd, .bp or .vtkhdf", lambda: write("fields.vtu"))
    monkeypatch.delattr(io, "VTXWriter", raising=False)
    raises_everywhere(WORLD, ValueError, "ADIOS2", lambda: write(folder / "fields.bp"))


# --- Table


def read(filename):
    with open(filename, newline="") as file:
        return [{k: float(v) for k, v in line.items()} for line in csv.DictReader(file)]


def test_history(folder, capsys):
    """Numbers are written exactly; after a restart, lines after the checkpoint are replaced."""
    case = Upset()
    history = qs.History(WORLD, folder / "run.csv", t_end=0.1)
    rows = []
    for _ in case.stepper.run(0.15):
        rows.append(qs.step_row(case.stepper) | {"third": np.float64(1) / 3})
        history.add(rows[-1])
    history.close()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == (3 if WORLD.rank == 0 else 0)
    assert all(line.startswith("step ") and ", t 0." in line for line in lines)
    WORLD.barrier()
    assert read(folder / "run.csv") == rows == history.rows
    assert list(rows[0])[:5] == ["step", "t", "dt", "iterations", "cutbacks"]
    again = qs.History(WORLD, folder / "run.csv", verbose=False, append=True)
    other = rows[1] | {"dt": 0.07}
    again.add(other)
    again.add(rows[2])
    WORLD.barrier()
    assert read(folder / "run.csv") == [rows[0], other, rows[2]]
    raises_everywhere(WORLD, ValueError, "row", lambda: again.add({"t": 1.0}))
    fresh = qs.History(WORLD, folder / "run.csv", verbose=False, append=True)
    raises_everywhere(WORLD, ValueError, "other columns", lambda: fresh.add({"t": 1.0}))
    (folder / "gone").mkdir(exist_ok=True)
    WORLD.barrier()
    missing = qs.History(WORLD, folder / "gone" / "run.csv", verbose=False)
    WORLD.barrier()
    if WORLD.rank == 0:
        (folder / "gone").rmdir()
    raises_everywhere(WORLD, OSError, "gone", lambda: missing.add(rows[0]))


def test_new_table(folder):
    """Unless lines are to be appended, a run replaces the table of an earlier one."""
    for t in (1.0, 2.0):
        history = qs.History(WORLD, folder / "run.csv", verbose=False)
        history.add({"t": t})
        history.close()
        WORLD.barrier()
    assert read(folder / "run.csv") == [{"t": 2.0}]


def test_no_part_of_a_line_after_an_error(folder):
    """A line for which the disk has no space is removed; the next one is complete."""
    history = qs.History(WORLD, folder / "full.csv", verbose=False)
    history.add({"t": 1.0, "force": 0.1})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    size = WORLD.bcast((folder / "full.csv").stat().st_size if WORLD.rank == 0 else 0, root=0)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 4, limits[1]))
    try:
        raises_everywhere(WORLD, OSError, "", lambda: history.add({"t": 2.0, "force": 0.2}))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    left = WORLD.allgather((folder / "full.csv").stat().st_size)
    history.add({"t": 3.0, "force": 0.3})
    WORLD.barrier()
    assert left == [size] * WORLD.size
    assert read(folder / "full.csv") == [{"t": 1.0, "force": 0.1}, {"t": 3.0, "force": 0.3}]


@pytest.mark.parametrize("with_tqdm", [True, False])
def test_progress_bar_is_optional(with_tqdm, monkeypatch, capsys):
    original = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "tqdm" and not with_tqdm:
            raise ImportError(name)
        return original(name, *args, **kwargs)

    if with_tqdm:
        pytest.importorskip("tqdm")
    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    history = qs.History(WORLD, t_end=1.0)
    history.add({"t": 0.5})
    history.close()
    assert bool(capsys.readouterr().out) == (not with_tqdm and WORLD.rank == 0)


def pieces(filename):
    """For each time of a .pvd file: time, and numbers of points and cells over all ranks."""
    out = []
    for entry in xml.etree.ElementTree.parse(filename).iter("DataSet"):
        top = xml.etree.ElementTree.parse(filename.with_name(entry.get("file")))
        files = [filename.with_name(piece.get("Source")) for piece in top.iter("Piece")]
        trees = [xml.etree.ElementTree.parse(file) for file in files]
        found = [piece for tree in trees for piece in tree.iter("Piece")]
        arrays = {
            array.get("Name"): [float(x) for x in array.text.split()]
            for tree in trees
            for array in tree.iter("DataArray")
        }
        cells = sum(int(piece.get("NumberOfCells")) for piece in found)
        out.append((float(entry.get("timestep")), cells, arrays))
    return out


@pytest.mark.parametrize("degree", [1, 2])
def test_vtk_of_changing_meshes(folder, degree):
    """A .pvd file has the mesh at each time, which may change with change_mesh."""
    filename = folder / "out.pvd"
    meshes = [box(WORLD, n, "triangle", [0.0, 0.0], [1.0, 1.0]) for n in ((3, 2), (4, 5))]
    fields = []
    for msh in meshes:
        u = fem.Function(fem.functionspace(msh, ("Lagrange", degree, (2,))))
        u.interpolate(lambda x: 2.0 * x[:2])
        T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
        T.interpolate(lambda x: 3.0 + 0.0 * x[0])
        fields.append({"T": T, "div": ufl.div(u)})
    with qs.FieldWriter(filename, meshes[0], fields[0]) as writer:
        writer.write(0.5)
        meshes[0].geometry.x[:] *= 2.0
        writer.write(1.0)
        with pytest.raises(ValueError, match="fields: must be those before"):
            writer.change_mesh(meshes[1], {"T": fields[1]["T"]})
        with pytest.raises(ValueError, match="'T' is on another mesh"):
            writer.change_mesh(meshes[1], fields[0])
        writer.change_mesh(meshes[1], fields[1])
        writer.write(1.5)
    WORLD.barrier()
    found = pieces(filename)
    assert [t for t, _, _ in found] == [0.5, 1.0, 1.5]
    if WORLD.size == 1:  # ghost cells are written, too
        assert [cells for _, cells, _ in found] == [12, 12, 40]
    for t, _, arrays in found:
        np.testing.assert_allclose(arrays["T"], 3.0)
        np.testing.assert_allclose(arrays["div"], 2.0 if t == 1.0 else 4.0, rtol=1e-12)
    WORLD.barrier()


def test_only_vtk_changes_meshes(folder):
    msh = box(WORLD, (2, 2), "triangle", [0.0, 0.0], [1.0, 1.0])
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    with qs.FieldWriter(folder / "out.xdmf", msh, {"T": T}) as writer:
        with pytest.raises(ValueError, match=r"only \.pvd files can go on"):
            writer.change_mesh(msh, {"T": T})


def test_degree_two(folder):
    """Functions of degree 2 are written at vertices, discontinuous ones in cells."""
    msh = box(WORLD, (3, 2), "triangle", [0.0, 0.0], [1.0, 1.0])
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 2)))
    v = fem.Function(fem.functionspace(msh, ("DG", 2)))
    for function in (u, v):
        function.interpolate(lambda x: x[0] ** 2 + 2 * x[1])
    with qs.FieldWriter(folder / "out.xdmf", msh, {"u": u, "v": v}) as writer:
        writer.write(0.0)
    WORLD.barrier()
    x = stored(folder / "out.h5", "Mesh/mesh/geometry").reshape(-1, 2)
    at_vertices = dataset(folder / "out.h5", "Function/u/0")
    assert at_vertices == pytest.approx(np.sort(x[:, 0] ** 2 + 2 * x[:, 1]), abs=1e-14)
    num_cells = msh.topology.index_map(2).size_global
    assert len(dataset(folder / "out.h5", "Function/v/0")) == num_cells
