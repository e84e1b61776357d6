"""Cases that an outside tester found: voids, parts, large coordinates, and refused input."""

from mpi4py import MPI

import numpy as np
import pytest
from remeshing_scenes import Upset, num_cells, tagged, volume
from scenes import WORLD, box, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import model_to_mesh

pytest.importorskip("gmsh")


def drawn(gdim, draw, size):
    """A mesh of a body that is drawn with gmsh's OpenCASCADE kernel."""
    import gmsh

    gmsh.initialize(["", "-v", "0"])
    if WORLD.rank == 0:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        bodies = [tag for _, tag in gmsh.model.getEntities(gdim)]
        gmsh.model.addPhysicalGroup(gdim, bodies, 1)
        skin = gmsh.model.getBoundary([(gdim, b) for b in bodies], oriented=False)
        for _, tag in skin:
            gmsh.model.addPhysicalGroup(gdim - 1, [tag], tag)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(gdim)
    msh, _, tags = model_to_mesh(gmsh.model, WORLD, gdim=gdim)
    gmsh.finalize()
    return msh, tags


def void(occ):
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(0.3, 0.3, 0.3, 0.4, 0.4, 0.4))])


def island(occ):
    void(occ)
    occ.addBox(0.4, 0.4, 0.4, 0.2, 0.2, 0.2)


def void_beside_a_part(occ):
    void(occ)
    occ.addBox(2, 0, 0, 1, 1, 1)


def two_rectangles(occ):
    occ.addRectangle(0, 0, 0, 3, 3)
    occ.addRectangle(4, 0, 0, 1, 1)


def hole_and_island(occ):
    occ.cut([(2, occ.addRectangle(0, 0, 0, 3, 3))], [(2, occ.addRectangle(1, 1, 0, 1, 1))])
    occ.addRectangle(1.3, 1.3, 0, 0.4, 0.4)


def island_with_a_hole(occ):
    occ.cut([(2, occ.addRectangle(0, 0, 0, 6, 6))], [(2, occ.addRectangle(1, 1, 0, 4, 4))])
    occ.cut([(2, occ.addRectangle(1.5, 1.5, 0, 3, 3))], [(2, occ.addRectangle(2.5, 2.5, 0, 1, 1))])


def part_with_a_hole(occ):
    occ.addRectangle(0, 0, 0, 3, 3)
    occ.cut([(2, occ.addRectangle(4, 0, 0, 2, 2))], [(2, occ.addDisk(5, 1, 0, 0.4, 0.4))])


@pytest.mark.parametrize(
    ("gdim", "draw", "size"),
    [
        (3, void, 0.25),
        (3, island, 0.2),
        (3, void_beside_a_part, 0.3),
        (2, two_rectangles, 0.4),
        (2, hole_and_island, 0.3),
        (2, island_with_a_hole, 0.5),
        (2, part_with_a_hole, 0.3),
    ],
)
def test_parts_and_voids(gdim, draw, size):
    """Remeshing keeps the volume of the cells, and all tags."""
    msh, tags = drawn(gdim, draw, size)
    made = qs.remesh(msh, size, tags)
    assert volume(made.mesh) == pytest.approx(volume(msh), rel=1e-9)
    before, after = (
        set(np.concatenate(WORLD.allgather(np.unique(t.values)))) for t in (tags, made.facet_tags)
    )
    assert before == after


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_far_from_the_origin(offset):
    msh, _ = drawn(3, lambda occ: occ.addSphere(0, 0, 0, 1), 0.4)
    msh.geometry.x[:] += offset
    made = qs.remesh(msh, 0.4)
    assert volume(made.mesh) == pytest.approx(volume(msh), rel=1e-8)
    assert abs(made.report.volume_change) < 1e-9


@pytest.mark.parametrize("gradation", [0.5, None])
def test_fine_corner(gradation):
    """Sizes on the boundary are the requested ones, also within a coarse segment."""
    msh = box(WORLD, (6, 6), "triangle", [0.0, 0.0], [2.0, 2.0])

    def size(x):
        return np.where(np.hypot(x[0], x[1]) < 1e-9, 0.004, 0.3)

    made = qs.remesh(msh, size, gradation=gradation).mesh
    x = made.geometry.x
    on = x[(np.abs(x[:, 1]) < 1e-12) & (x[:, 0] > 1e-9), 0]
    assert WORLD.allreduce(on.min(initial=9.0), op=MPI.MIN) < 0.01


def test_refused():
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    u = fem.Function(vector_space(msh))

    def refuses(text, *arguments, error=ValueError, **options):
        with pytest.raises(error, match=text):
            qs.remesh(*arguments, **options)

    u.x.array[:] = np.nan
    refuses("body: coordinates and displacements must be finite", u, 0.3)
    u.interpolate(lambda x: (-2 * x[0], 0 * x[0]))
    refuses("body: the displacement turns .* cells inside out", u, 0.3)
    dg = fem.Function(fem.functionspace(msh, ("DG", 0, (2,))))
    refuses("body: a displacement must be continuous", dg, 0.3)
    refuses("size: must return a real number for each of its points", msh, lambda x: np.ones(3))
    refuses(r"size: would give about 2e\+10 cells", msh, 1e-5, error=qs.RemeshError)
    left = box(WORLD, (3, 3), "triangle", [-1.0, 0.0], [1.0, 1.0])
    refuses("axisymmetric: r, the first coordinate", left, 0.3, axisymmetric=True)
    if WORLD.size > 1:
        refuses("size: must be the same on all ranks", msh, 0.3 + WORLD.rank)
    wrong = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    wrong.x.array[:] = np.nan
    with pytest.raises(ValueError, match="function: must have finite values"):
        qs.transfer(wrong, wrong.function_space)
    for options in ({"min_quality": 2.0}, {"energy": wrong}, {"fields": wrong}):
        with pytest.raises(ValueError, match=r"min_quality: |fields, energy: "):
            qs.Remeshing(lambda meshes, tags: None, 0.3, **options)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"fields": lambda: [1.0]}, "fields: must return a dictionary"),
        ({"fields": lambda: {"a": 1.0}}, "fields: must return a dictionary"),
        ({"energy": lambda: 1.0}, "energy: must return a form of UFL"),
    ],
)
def test_what_callbacks_return(options, text):
    case = Upset(2, 3.0, remesh=options)
    with pytest.raises(TypeError, match=text):
        case.stepper.remesh()


def test_fields_of_the_old_mesh():
    """Fields of the old mesh that are returned after build are refused.

    The new problem would lose them.
    """
    case = Upset(2, 3.0, remesh={})
    old = case.strain
    case.stepper.remeshing.fields = lambda: {"strain": old}
    with pytest.raises(ValueError, match="'strain' must be on the new mesh after build"):
        case.stepper.remesh()
    assert case.stepper.problem.u[0].function_space.mesh is old.function_space.mesh


def test_tagged_box():
    """Cells are about as large as requested."""
    msh = box(WORLD, (4, 4), "triangle", [0.0, 0.0], [1.0, 1.0])
    made = qs.remesh(msh, 0.1, tagged(msh, [(0, 0.0)]))
    assert 150 < num_cells(made.mesh) < 400


@pytest.mark.parametrize("partition", ["first", "last"])
def test_ranks_without_cells(partition):
    """Transfer works for meshes that one rank has alone: a linear field is transferred exactly."""
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
    made = qs.remesh(msh, 0.3, tagged(msh, [(0, 0.0)]), axisymmetric=True)
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    T.interpolate(lambda x: 1.0 + 2.0 * x[0] - x[1])
    found = qs.transfer(T, fem.functionspace(made.mesh, ("Lagrange", 1)))
    back = qs.transfer(found, T.function_space)
    np.testing.assert_allclose(back.x.array, T.x.array, atol=1e-12)
    constant = fem.Function(fem.functionspace(msh, ("DG", 0)))
    constant.x.array[:] = 2.0
    cells = qs.transfer(constant, fem.functionspace(made.mesh, ("DG", 0)))
    np.testing.assert_allclose(cells.x.array, 2.0, rtol=1e-12)
