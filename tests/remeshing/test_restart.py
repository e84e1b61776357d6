"""Restart after remeshing, transfer of temperatures, and files with several meshes."""

import pathlib
import xml.etree.ElementTree

import numpy as np
import pytest
from remeshing_scenes import H, R, Upset, integral
from scenes import WORLD

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials

pytest.importorskip("gmsh")


@pytest.fixture
def folder(tmp_path_factory):
    """A folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0))


class Heated(Upset):
    """The billet with plastic heat, which flows into a cold lower die; K decreases with T."""

    c, cold, softening = 2.0, 20.0, 2e-3

    def build(self, meshes, tags):
        problem = super().build(meshes, tags)
        (msh,) = meshes
        V = fem.functionspace(msh, ("Lagrange", 1))
        self.T, self.before = fem.Function(V), fem.Function(V)
        self.before.x.array[:] = 100.0
        dt = fem.Constant(msh, self.dt)
        axisymmetric = self.dim == 2
        velocity = ufl.split(self.body.w)[0]
        source = materials.plastic_heat(self.body.stress, velocity, 0.9, axisymmetric)
        self.form = materials.heat(self.T, 5.0, self.c, self.before, dt, source, axisymmetric)
        lower = self.contacts[0]
        surface = qs.Surface(V, facets=lower.slave.facets, axisymmetric=axisymmetric)
        law = qs.Conductance(lambda p, g: 0.02 * p, tool=self.cold)
        self.across = qs.Contact(surface, lower.master, law=law, mechanics=lower)
        heat = qs.ContactProblem([self.form], [self.T], [self.across])
        return problem, qs.Staggered(heat, [self.before], dt)

    def content(self):
        """Heat content above 0 degrees."""
        weight = materials.axisymmetric_weight(self.mesh) if self.dim == 2 else 1.0
        return integral(self.c * weight * self.before * ufl.dx)


def heated(dim=2, **options):
    return Heated(dim, 2.0 if dim == 2 else 4.0, num_steps=8, **options)


def test_temperatures_go_on_as_on_one_mesh():
    """Temperatures with remeshing are those on one mesh; a remeshing keeps the heat to rounding."""
    alone, case = heated(), heated(remesh={"every": 3})
    forces = [one.run() for one in (alone, case)]
    assert len(case.stepper.remeshings) == 2
    assert np.allclose(*forces, rtol=0.01)
    assert case.content() == pytest.approx(alone.content(), rel=2e-3)
    rise = alone.content() - 100.0 * alone.c * np.pi * R**2 * H
    assert abs(rise) > 0.05 * alone.content()
    before = case.content()
    case.stepper.remesh()
    assert case.content() == pytest.approx(before, rel=1e-12)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.long)])
def test_restart_after_a_remeshing(folder, dim):
    """A restart from a checkpoint with a new mesh gives the results of an uninterrupted run."""
    case = heated(dim, remesh={"every": 3})
    steps = case.stepper.run(case.t_end)
    for _ in range(5):
        next(steps)
        case.add_strain()
    total = integral(case.strain * ufl.dx)
    qs.save_run(case.stepper, folder / "run", {"strain": case.strain}, {"force": 1.5})
    old = case.mesh
    for _ in steps:
        case.add_strain()
    meshes, tags = qs.load_meshes(WORLD, folder / "run")
    again = heated(dim, remesh={"every": 3}, meshes=(meshes, tags))
    assert again.mesh is not old
    found = qs.load_run(again.stepper, folder / "run", {"strain": again.strain})
    assert found == {"force": 1.5} and again.stepper.num_steps == 5
    assert integral(again.strain * ufl.dx) == pytest.approx(total, rel=1e-12) and total > 0
    for _ in again.stepper.run(case.t_end):
        again.add_strain()
    assert len(again.stepper.remeshings) == 1  # the remaining one
    forces = [one.contacts[1].force("slave")[-1] for one in (again, case)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-5)
    assert again.content() == pytest.approx(case.content(), rel=1e-7)
    strains = [integral(one.strain * ufl.dx) for one in (again, case)]
    assert strains[0] == pytest.approx(strains[1], rel=1e-5)


def test_checkpoint_without_new_meshes(folder):
    case = heated()
    case.stepper.step()
    qs.save_run(case.stepper, folder / "run")
    with pytest.raises(ValueError, match="saved without new meshes"):
        qs.load_meshes(WORLD, folder / "run")
    with pytest.raises(FileNotFoundError, match="there is no checkpoint"):
        qs.load_meshes(WORLD, folder / "nothing")


def test_film_through_new_meshes(folder):
    """In a .pvd file each time has the cells of the mesh at that time."""
    case = heated(remesh={"every": 3})
    writer = qs.FieldWriter(folder / "film.pvd", case.mesh, {"T": case.before})
    cells, written = [], case.mesh
    for t in case.stepper.run(case.t_end):
        if case.mesh is not written:
            writer.change_mesh(case.mesh, {"T": case.before})
            written = case.mesh
        writer.write(t)
        cells.append(case.mesh.topology.index_map(2).size_global)
    writer.close()
    WORLD.barrier()
    assert len(set(cells)) > 1
    found = [
        sum(
            int(piece.get("NumberOfCells"))
            for part in pieces(folder / entry.get("file"))
            for piece in xml.etree.ElementTree.parse(part).iter("Piece")
        )
        for entry in xml.etree.ElementTree.parse(folder / "film.pvd").iter("DataSet")
    ]
    if WORLD.size == 1:  # several ranks write ghost cells, too
        assert found == cells
    assert len(found) == len(cells)


def pieces(filename):
    tree = xml.etree.ElementTree.parse(filename)
    return [filename.with_name(piece.get("Source")) for piece in tree.iter("Piece")]
