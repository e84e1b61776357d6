"""Bad input: one clear exception, the same on every rank, that names the argument."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    curved_triangle,
    elastic,
    plane,
    raises_everywhere,
    vector_space,
)

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.base.collective import collective_errors


def square(cell="triangle", n=4):
    msh = box(WORLD, [n, n], cell, [0, 0], [1, 1])
    return msh, vector_space(msh), plane(msh, 1, 0.0)


def tags_of(msh, facets, tag=1, dim=1):
    values = np.full(len(facets), tag, dtype=np.int32)
    return mesh.meshtags(msh, dim, np.sort(facets).astype(np.int32), values)


def surface_error(error, match, V, *args, **kwargs):
    raises_everywhere(WORLD, error, match, lambda: qs.Surface(V, *args, **kwargs))


def test_tags():
    msh, V, facets = square()
    surface_error(ValueError, "empty", V, tags_of(msh, facets), 2)
    surface_error(ValueError, "empty", V, facets=np.zeros(0, dtype=np.int32))
    surface_error(TypeError, "tag", V, tags_of(msh, facets))
    surface_error(TypeError, "facet_tags", V)
    surface_error(TypeError, "facets", V, tags_of(msh, facets), 1, facets=facets)
    cells = np.arange(msh.topology.index_map(2).size_local)
    surface_error(ValueError, "dimension 1", V, tags_of(msh, cells, dim=2), 1)


def test_facets():
    msh, V, _ = square()
    every = msh.topology.index_map(1).size_local
    surface_error(ValueError, "not on the boundary", V, facets=np.arange(every, dtype=np.int32))
    surface_error(ValueError, "facets", V, facets=np.array([10**6], dtype=np.int32))
    surface_error(ValueError, "facets", V, facets=np.array([-1], dtype=np.int32))
    surface_error(ValueError, "integers", V, facets=np.array([0.5]))
    surface_error(ValueError, "facets", V, facets=np.zeros((2, 2), dtype=np.int32))


def test_one_rank_alone_cannot_make_the_others_wait():
    """Only the last rank is given a bad index."""
    _, V, facets = square()
    given = facets if WORLD.rank < WORLD.size - 1 else np.array([-5], dtype=np.int32)
    surface_error(ValueError, "facets", V, facets=given)


@pytest.mark.parametrize(
    "element, match",
    (
        (("Lagrange", 1), "vector"),
        (("Lagrange", 1, (3,)), "vector"),
        (("Lagrange", 3, (2,)), "degree 1 or 2"),
        (("DG", 1, (2,)), "degree 1 or 2"),
        (("DG", 0, (2,)), "degree 1 or 2"),
        (("CR", 1, (2,)), "degree 1 or 2"),
    ),
)
def test_spaces(element, match):
    msh, _, facets = square()
    surface_error(ValueError, match, fem.functionspace(msh, element), facets=facets)


def test_meshes():
    msh = mesh.create_unit_interval(WORLD, 8)
    V = fem.functionspace(msh, ("Lagrange", 1, (1,)))
    surface_error(ValueError, "triangles", V, facets=np.array([0], dtype=np.int32))
    msh = curved_triangle()
    V = vector_space(msh)
    msh.topology.create_connectivity(1, 2)
    surface_error(ValueError, "degree 1", V, facets=mesh.exterior_facet_indices(msh.topology))


def test_coordinates():
    for value, match in ((np.nan, "finite"), (np.inf, "finite")):
        msh, V, facets = square()
        msh.geometry.x[np.isclose(msh.geometry.x[:, 1], 0), 0] = value
        surface_error(ValueError, match, V, facets=facets)
    msh, V, facets = square()
    surface = qs.Surface(V, facets=facets)
    msh.geometry.x[np.isclose(msh.geometry.x[:, 1], 0), 0] = np.nan
    raises_everywhere(WORLD, ValueError, "finite", surface.update)


def test_tags_of_another_mesh():
    _, V, _ = square()
    other = box(WORLD, [7, 5], "triangle", [0, 0], [1, 1])
    surface_error(ValueError, "facet_tags", V, tags_of(other, plane(other, 1, 0.0)), 1)


@pytest.mark.parametrize("place", ((0.45, 0.45), (0.5, 0.5), (1.2, 1.2)))
def test_quadrilaterals_that_are_not_convex(place):
    """One corner is drawn over or onto the diagonal of its facet."""
    msh = box(WORLD, [1, 1, 1], "hexahedron", [0, 0, 0], [1, 1, 1])
    x = msh.geometry.x
    x[np.all(np.isclose(x, [1, 1, 0]), axis=1), :2] = place
    V, facets = vector_space(msh), plane(msh, 2, 0.0)
    if place[0] > 0.5:
        assert np.isclose(qs.Surface(V, facets=facets).area, 1.2)
    else:
        surface_error(ValueError, "convex", V, facets=facets)


def test_one_space_for_two_bodies():
    pair = Pair("triangle")
    u = [pair.u[0], fem.Function(pair.V[0])]
    F = [elastic(v) for v in u]
    raises_everywhere(WORLD, ValueError, "own", lambda: qs.ContactProblem(F, u, []))


def test_wrong_types():
    pair = Pair("triangle")
    F, u, bcs, c = pair.F, pair.u, pair.bcs, [pair.contact]
    msh, V, facets = square()
    for match, V_given, kwargs in (
        ("V:", msh, {"facets": facets}),
        ("facet_tags:", V, {"facet_tags": np.ones(3, dtype=np.int32), "tag": 1}),
        ("tag:", V, {"facet_tags": tags_of(msh, facets), "tag": "1"}),
    ):
        surface_error(TypeError, match, V_given, **kwargs)
    for match, arguments in (
        ("u:", (F, [f.function_space for f in u], c, bcs)),
        ("u:", (F, u[0], c, bcs)),
        ("contacts:", (F, u, pair.contact, bcs)),
        ("F:", (F[0], u, c, bcs)),
        ("F:", ([F[0], None], u, c, bcs)),
        ("petsc_options:", (F, u, c, bcs)),
    ):
        options = "ksp_type cg" if match.startswith("petsc") else None
        raises_everywhere(
            WORLD,
            TypeError,
            match,
            lambda a=arguments, o=options: qs.ContactProblem(*a, petsc_options=o),
        )


def test_wrong_forms():
    pair = Pair("triangle")
    u, v = pair.u[0], ufl.TestFunction(pair.V[0])
    bilinear = ufl.inner(ufl.TrialFunction(pair.V[0]), v) * ufl.dx
    without = ufl.inner(ufl.as_vector([1.0, 0.0]), v) * ufl.dx
    for match, F, J in (
        ("F: entry 0", pair.F[::-1], None),
        ("F: entry 0 must", [bilinear, pair.F[1]], None),
        ("F: entry 0 does not depend", [without, pair.F[1]], None),
        ("J: entry 0", pair.F, [elastic(u), None]),
        ("J: entry 1", pair.F, [None, bilinear]),
    ):
        raises_everywhere(
            WORLD,
            ValueError,
            match,
            lambda F=F, J=J: qs.ContactProblem(F, pair.u, [pair.contact], pair.bcs, J),
        )


@pytest.mark.skipif(WORLD.size == 1, reason="needs two ranks")
def test_ranks_that_disagree():
    """A penalty from a rank's own mesh size, say."""
    pair = Pair("triangle")
    for name, mine, others in (
        ("penalty", 10.0, 20.0),
        ("penalty", "auto", 20.0),
        ("formulation", "master-slave", "double-pass"),
        ("law", qs.Tied(), qs.Unilateral()),
        ("search_radius", 0.1, None),
    ):
        value = mine if WORLD.rank == 0 else others
        raises_everywhere(
            WORLD,
            ValueError,
            name,
            lambda k={name: value}: qs.Contact(pair.slave, pair.master, **k),
        )
    raises_everywhere(
        WORLD, ValueError, "penalty", lambda: pair.contact.set_penalty(1.0 + WORLD.rank)
    )


def test_exceptions_that_cannot_travel():
    """Whatever one rank raises, all ranks raise something, and none hangs."""

    class Local(Exception):
        pass

    for error in (Local("this"), UnicodeDecodeError("utf-8", b"", 0, 1, "this"), PETSc.Error(62)):
        found = None
        try:
            with collective_errors(WORLD):
                if WORLD.rank == WORLD.size - 1:
                    raise error
        except Exception as e:
            found = e
        assert found is not None
        assert isinstance(found, type(error) if WORLD.rank == WORLD.size - 1 else RuntimeError)


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_degenerate_facets(cell):
    gdim = 2 if cell == "triangle" else 3
    msh = box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
    facets = plane(msh, gdim - 1, 0.0)
    x = msh.geometry.x
    x[np.isclose(x[:, gdim - 1], 0) & (x[:, 0] < 0.4), 0] = 0  # the first row of facets is flat
    surface_error(ValueError, "zero area", vector_space(msh), facets=facets)


def contact_error(error, match, *args, **kwargs):
    raises_everywhere(WORLD, error, match, lambda: qs.Contact(*args, **kwargs))


def test_contact_arguments():
    pair = Pair("triangle")
    s, m = pair.slave, pair.master
    contact_error(ValueError, "formulation", s, m, "mortar")
    contact_error(TypeError, "law", s, m, law="tied")
    contact_error(TypeError, "law", s, m, law=qs.Tied)
    for bad in (-1.0, 0.0, np.nan, np.inf, "stiff", None, True, [1.0]):
        contact_error(ValueError, "penalty", s, m, penalty=bad)
    for bad in (-1.0, 0.0, np.nan, "far"):
        contact_error(ValueError, "search_radius", s, m, search_radius=bad)
    contact_error(TypeError, "slave", pair.V[0], m)
    contact_error(TypeError, "master", s, None)
    contact_error(ValueError, "share facets", s, s)
    contact_error(ValueError, "share facets", s, qs.Surface(s.V, facets=s.facets))
    other = Pair("tetrahedron", n=(2, 2))
    contact_error(ValueError, "dimension", s, other.master)
    contact = pair.contact
    raises_everywhere(WORLD, ValueError, "penalty", lambda: contact.set_penalty(-1))
    raises_everywhere(WORLD, ValueError, "side", lambda: contact.traction("left"))
    raises_everywhere(WORLD, ValueError, "side", lambda: contact.force("both"))
    raises_everywhere(WORLD, ValueError, "no multiplier", lambda: contact.gap("master"))
    automatic = qs.Contact(s, m)
    raises_everywhere(WORLD, RuntimeError, "first solve", lambda: automatic.energy)
    assert contact.penalty == 30.0


def test_problem_arguments():
    pair = Pair("triangle")
    F, u, contacts, bcs = pair.F, pair.u, [pair.contact], pair.bcs

    def problem_error(match, *args, **kwargs):
        raises_everywhere(WORLD, ValueError, match, lambda: qs.ContactProblem(*args, **kwargs))

    problem_error("F:", F[:1], u, contacts, bcs)
    problem_error("bcs:", F, u, contacts, bcs[:1])
    problem_error("list of lists", F, u, contacts, [b[0] for b in bcs])
    problem_error("J:", F, u, contacts, bcs, [None])
    problem_error("kind", F, u, contacts, bcs, kind="aij")
    problem_error("contacts:", F, u, [pair.slave], bcs)
    problem_error("at least one", [], [], [])
    problem_error("master surface", F[1:], u[1:], contacts, bcs[1:])
    problem_error("slave surface", F[:1], u[:1], contacts, bcs[:1])
    problem_error("bcs: ", F, u, contacts, bcs[::-1])


def test_complex_petsc(monkeypatch):
    _, V, facets = square()
    monkeypatch.setattr(PETSc, "ScalarType", np.complex128)
    surface_error(TypeError, "complex", V, facets=facets)


@pytest.mark.parametrize("height", [0.0, 0.5])
def test_nothing_is_changed(height):
    """NaN in a contact facet, or elsewhere in its cell, is refused and leaves all as it was."""
    pair = Pair("quadrilateral")
    before, node = pair.contact.pairing, pair.slave.node_x.copy()
    x = pair.meshes[1].geometry.x
    x[np.isclose(x[:, 1], height)] = np.nan
    raises_everywhere(WORLD, ValueError, "finite", pair.contact.update)
    np.testing.assert_array_equal(before.slave.x, pair.contact.pairing.slave.x)
    np.testing.assert_array_equal(node, pair.slave.node_x)


def test_values_of_clamps_are_checked_by_dolfinx():
    """Conditions on spaces of another body are refused before anything is assembled."""
    pair = Pair("triangle")
    other = Pair("triangle")
    wrong = [[clamp(other.V[0], plane(other.meshes[0], 1, -1.0))], pair.bcs[1]]
    F = [elastic(u) for u in pair.u]
    raises_everywhere(
        WORLD, ValueError, "bcs", lambda: qs.ContactProblem(F, pair.u, [pair.contact], wrong)
    )
