"""Options of the C compiler, and quadrature degrees that UFL has estimated."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, Pair, box, elastic, gathered, vector_space

import ufl
from dolfinx import fem, jit

import qsdolfinx as qs
from qsdolfinx.system.compiling import OPTIMISED, Compiling
from qsdolfinx.system.estimated_degree import waste

DOLFINX = {"cffi_extra_compile_args": ["-O2", "-g0"]}


def neo_hooke(u, dx):
    """Compressible neo-Hookean body."""
    F = ufl.Identity(len(u)) + ufl.grad(u)
    J = ufl.det(F)
    W = (ufl.tr(F.T * F) - len(u)) / 2 - ufl.ln(J) + ufl.ln(J) ** 2
    return ufl.derivative(W * dx, u)


def solved(degree=None, **options):
    """Solve two neo-Hookean blocks; return displacements of a body and the contact force."""
    pair = Pair("hexahedron", n=(7, 3))
    dx = ufl.dx if degree is None else ufl.dx(metadata={"quadrature_degree": degree})
    pair.F[:] = [neo_hooke(u, dx) for u in pair.u]
    pair.problem(**options).solve()
    owned = pair.V[0].dofmap.index_map.size_local * 3
    return gathered(WORLD, pair.u[0].x.array[:owned]), pair.contact.force("slave")


@pytest.mark.parallel
def test_rounding_alone():
    """Options of the compiler change results by rounding alone."""
    (u, force), (v, other) = solved(degree=3), solved(degree=3, jit_options=DOLFINX)
    np.testing.assert_allclose(u, v, atol=1e-12)
    np.testing.assert_allclose(force, other, atol=1e-12)


def test_the_user_chooses(monkeypatch):
    """Arguments in ``jit_options``, or in the user's file, are the only ones."""
    used = []
    monkeypatch.setattr(fem, "form", lambda form, **options: used.append(options["jit_options"]))
    form = elastic(fem.Function(vector_space(box(WORLD, [1, 1], "triangle", [0, 0], [1, 1]))))
    Compiling().form(form)
    Compiling(jit_options={"timeout": 20}).form(form)
    Compiling(jit_options=DOLFINX).form(form)
    monkeypatch.setattr(jit, "get_options", lambda given: {"cffi_extra_compile_args": ["-O0"]})
    Compiling().form(form)
    assert all(used[i]["cffi_extra_compile_args"][: len(OPTIMISED)] == OPTIMISED for i in (0, 1))
    assert used[1]["timeout"] == 20
    assert used[2:] == [DOLFINX, None]


def test_compiler_that_refuses(tmp_path, monkeypatch, caplog):
    """A compiler that does not know our options gets DOLFINx's, with a message."""
    monkeypatch.setattr("qsdolfinx.system.compiling.OPTIMISED", ["-no-such-option"])
    V = vector_space(box(WORLD, [1, 1], "triangle", [0, 0], [1, 1]))
    form = Compiling(jit_options={"cache_dir": tmp_path}).form(elastic(fem.Function(V)))
    assert fem.assemble_vector(form).array.shape == (8,)
    assert "forms are compiled with DOLFINx's options, since" in caplog.text


def test_what_is_no_number_stays_so():
    """NaN and infinity in a coefficient are in the assembled form, and not optimised away."""
    msh = box(WORLD, [1, 1], "triangle", [0, 0], [1, 1])
    V = fem.functionspace(msh, ("DG", 0))
    c, v = fem.Function(V), ufl.TestFunction(V)
    form = Compiling().form((c - ufl.sqrt(c * c)) * v * ufl.dx)
    for value in (np.nan, np.inf):
        c.x.array[:] = value
        assert np.isnan(fem.assemble_vector(form).array).all()


@pytest.mark.parallel
def test_estimated_degree():
    """The warning names a degree with which it is gone; results differ little."""
    text = r"F: for entry 0 UFL estimates .*: 1331 points in each cell, where 8, of degree 3, are"
    with pytest.warns(qs.ContactWarning, match=text):
        u, force = solved()
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ContactWarning)
        v, other = solved(degree=3)
    assert np.abs(u - v).max() < 1e-4 * np.abs(u).max()
    np.testing.assert_allclose(force, other, rtol=1e-4, atol=1e-9)


def test_degree_that_does_not_matter():
    """Small meshes, and the estimate for linear bodies (27 points for 8), are not worth it."""
    pair = Pair("hexahedron", n=(6, 3))
    pair.F[:] = [neo_hooke(u, ufl.dx) for u in pair.u]
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ContactWarning)
        pair.problem().solve()
    u = fem.Function(vector_space(box(WORLD, [18] * 3, "hexahedron", [0] * 3, [1] * 3)))
    assert waste(ufl.derivative(elastic(u), u), u.function_space) is None
