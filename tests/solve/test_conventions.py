"""Conventions of DOLFINx's NonlinearProblem: one body or lists, flat conditions, form options."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    elastic,
    plane,
    raises_everywhere,
    vector_space,
)

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


class Pressed:
    """A square on a rigid plane, pressed at its top; Young's modulus may be a Function."""

    def __init__(self, modulus=1.0, **options):
        msh = box(WORLD, [4, 4], "quadrilateral", [0, 0], [1, 1])
        V = vector_space(msh)
        self.u = fem.Function(V)
        self.F = elastic(self.u, E=modulus, nu=0.0)
        bc = clamp(V, plane(msh, 1, 1.0), [0.0, -0.1])
        tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        self.contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool)
        self.problem = qs.ContactProblem(self.F, self.u, self.contact, [bc], **options)


@pytest.mark.parallel
def test_one_body_without_lists():
    """The unknown is returned as it was given; the force is E × strain × width."""
    case = Pressed(modulus=10.0)
    assert case.problem.solve() is case.u
    # Uniaxial, except for the Poisson effect at the clamp, which is absent with nu = 0.
    np.testing.assert_allclose(case.contact.force("slave"), [0, 1.0], atol=1e-8)
    assert isinstance(case.problem.solver, PETSc.SNES)
    assert case.problem.linear_solver == "direct"


@pytest.mark.parallel
def test_conditions_in_one_list():
    """Conditions in one list, in any order, are assigned to the bodies by their spaces."""
    pair = Pair("quadrilateral")
    qs.ContactProblem(pair.F, pair.u, [pair.contact], pair.bcs).solve()
    nested = [u.x.array.copy() for u in pair.u]
    other = Pair("quadrilateral")
    flat = [bc for entry in reversed(other.bcs) for bc in entry]
    problem = qs.ContactProblem(other.F, other.u, [other.contact], flat)
    problem.solve()
    assert [len(body.bcs) for body in problem.bodies] == [len(entry) for entry in other.bcs]
    for a, b in zip(nested, other.u, strict=True):
        np.testing.assert_allclose(a, b.x.array, atol=1e-9)


@pytest.mark.parallel
def test_conditions_that_fit_nowhere():
    """The error names the entry of a condition that fits no body."""
    pair, other = Pair("quadrilateral"), Pair("quadrilateral")
    with pytest.raises(ValueError, match="bcs: entry 0 is on the space of none of u"):
        qs.ContactProblem(pair.F, pair.u, [pair.contact], other.bcs[0])
    with pytest.raises(TypeError, match=r"bcs: must be one list of .*, not both"):
        qs.ContactProblem(pair.F, pair.u, [pair.contact], [*pair.bcs[0], pair.bcs[1]])


def test_options_of_forms(tmp_path):
    """The form compiler gets the options: both forms are in the cache folder that they name."""
    tmp_path = WORLD.bcast(tmp_path)
    case = Pressed(jit_options={"cache_dir": tmp_path}, form_compiler_options={"epsilon": 1e-12})
    case.problem.solve()
    assert len(list(tmp_path.glob("libffcx_forms_*.c"))) == 2
    with pytest.raises(TypeError, match="jit_options: must be a dictionary"):
        Pressed(jit_options=["-O3"])


@pytest.mark.skipif(not hasattr(mesh, "EntityMap"), reason="maps are objects from 0.10 on")
def test_coefficients_on_a_mesh_of_some_cells():
    """The modulus may be a Function on a sub-mesh of the body's cells."""
    msh = box(WORLD, [4, 4], "quadrilateral", [0, 0], [1, 1])
    V = vector_space(msh)
    cells = np.arange(msh.topology.index_map(2).size_local, dtype=np.int32)
    part, entity_map, *_ = mesh.create_submesh(msh, 2, cells)
    modulus = fem.Function(fem.functionspace(part, ("DG", 0)))
    modulus.x.array[:] = 10.0
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = modulus * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx(domain=msh)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool)
    bc = clamp(V, plane(msh, 1, 1.0), [0.0, -0.1])
    qs.ContactProblem(F, u, contact, [bc], entity_maps=[entity_map]).solve()
    np.testing.assert_allclose(contact.force("slave"), [0, 1.0], atol=1e-8)


@pytest.mark.parallel
def test_names_of_before():
    """``solver=`` still means ``linear_solver=``.

    Giving both is refused, and so are contacts with the same name.
    """
    pair = Pair("quadrilateral")
    given = pair.F, pair.u, [pair.contact], pair.bcs
    with pytest.warns(DeprecationWarning, match="solver= is linear_solver= now"):
        assert qs.ContactProblem(*given, solver="direct").linear_solver == "direct"
    last = {"solver": "direct"} if WORLD.rank == WORLD.size - 1 else {}
    text = "solver, linear_solver: are the same"
    raises_everywhere(
        WORLD, ValueError, text, lambda: qs.ContactProblem(*given, linear_solver="amg", **last)
    )
    last = {"of": pair.contact} if last else {}
    surfaces, text = (pair.slave, pair.master), "mechanics: "  # other ranks refuse it for vectors
    raises_everywhere(
        WORLD, ValueError, text, lambda: qs.Contact(*surfaces, mechanics=pair.contact, **last)
    )
    two = [qs.Contact(pair.slave, pair.master, name="pad") for _ in range(2)]
    with pytest.raises(ValueError, match="contacts: several are called 'pad'"):
        qs.ContactProblem(pair.F, pair.u, two, pair.bcs)


def test_options_that_do_not_suit():
    """The error of DOLFINx names the arguments that may have caused it."""
    kinds, text = (
        (TypeError, RuntimeError),
        "jit_options, entity_maps: DOLFINx does not accept one of these",
    )
    with pytest.raises(kinds, match=text):
        Pressed(jit_options={"no such option": 1})
