"""Leaves that bend on each other, clamped at one end: contact moves along the shorter leaves."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic_form, plane

import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

E, HEIGHT, LENGTH, FORCE = 1000.0, 0.1, 1.0, 1e-3


def leaf(cells, length, low, degree=2):
    """Mesh, space, displacement and clamp at the left end of a leaf."""
    msh = box(WORLD, (cells, 2), "quadrilateral", [0.0, low], [length, low + HEIGHT])
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    return msh, V, fem.Function(V), clamp(V, plane(msh, 0, 0.0))


def tip(cells, degree=2, steps=None, **options):
    """Deflection of the longer leaf's loaded tip over that of beam theory; iterations of steps."""
    long_, short = (
        leaf(cells, 3 * LENGTH, 0.0, degree),
        leaf(round(2.3 * cells / 3), 2 * LENGTH, -HEIGHT, degree),
    )
    F = []
    for msh, V, u, _ in (long_, short):
        F.append(elastic_form(u, ufl.TestFunction(V), E, 0.0))
    msh, V, u, _ = long_
    end = plane(msh, 0, 3 * LENGTH)
    ds = ufl.Measure("ds", msh, subdomain_data=mesh.meshtags(msh, 1, end, np.ones_like(end)))(1)
    load = fem.Constant(msh, (0.0, FORCE / HEIGHT))
    F[0] += ufl.inner(load, ufl.TestFunction(V)) * ds
    below = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], 0.0) & (x[0] <= 2.3 * LENGTH)
    )
    surfaces = qs.Surface(V, facets=below), qs.Surface(short[1], facets=plane(short[0], 1, 0.0))
    contact = qs.Contact(*surfaces, **options)
    bcs = [[long_[3]], [short[3]]]
    problem = qs.ContactProblem(F, [long_[2], short[2]], [contact], bcs)
    if steps is None:
        problem.solve()
        iterations = [problem.num_iterations]
    else:

        def drive(t, dt):
            load.value[1] = t * FORCE / HEIGHT

        stepper = qs.TimeStepper(problem, 1 / steps, drive)
        iterations = [stepper.num_iterations for _ in stepper.run(1.0)]
        assert stepper.num_cutbacks == 0
    lowered = float(WORLD.allreduce(-u.x.array.min(), op=MPI.MAX))
    inertia = HEIGHT**3 / 12
    beams = 118 / 24 * FORCE * LENGTH**3 / (E * inertia)
    return lowered / beams, iterations


FRICTION = {"friction": qs.Coulomb(0.3)}


@pytest.mark.parametrize(
    ("cells", "degree", "options"),
    [
        (20, 2, {}),
        (80, 2, {}),
        (40, 2, FRICTION),
        (40, 2, {"enforcement": "penalty"}),
        (40, 2, FRICTION | {"sliding": "finite"}),
        pytest.param(160, 1, FRICTION | {"enforcement": "penalty"}, marks=pytest.mark.long),
        pytest.param(160, 1, {"sliding": "finite"}, marks=pytest.mark.long),
        pytest.param(80, 2, FRICTION | {"formulation": "master-slave"}, marks=pytest.mark.long),
    ],
)
def test_two_leaves(cells, degree, options):
    """Leaves bend like beams that touch at the shorter leaf's tip.

    The number of iterations does not grow with the number of facets.
    """
    found, (iterations,) = tip(cells, degree, **options)
    assert found == pytest.approx(1.0, abs=0.025 if degree == 2 else 0.06)
    assert iterations <= 21


def test_two_leaves_in_steps():
    """The first step has the same difficulties at any load: smaller steps do not help there."""
    found, iterations = tip(40, steps=4, **FRICTION)
    assert found == pytest.approx(1.0, abs=0.025)
    assert iterations[0] <= 20
    assert max(iterations[1:]) <= 3


@pytest.mark.parametrize(
    ("degree", "options"),
    [
        (2, {}),
        (2, FRICTION),
        (1, {}),
        (2, FRICTION | {"enforcement": "penalty"}),
        pytest.param(2, FRICTION | {"sliding": "finite"}, marks=pytest.mark.long),
    ],
)
def test_pack_of_three(degree, options):
    """Shorter leaves carry what beams do that touch at their tips, in one solve from rest."""
    height, modulus, force = 0.4, 1e5, 1.5
    lengths, cells = (10.0, 7.0, 4.0), (50, 32, 22)
    F, u, bcs, sides = [], [], [], []
    for i, (length, n) in enumerate(zip(lengths, cells, strict=True)):
        low, across = -i * height, 2 if degree == 2 else 4
        msh = box(WORLD, (n, across), "quadrilateral", [0.0, low], [length, low + height])
        V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        own = fem.Function(V)
        F.append(elastic_form(own, ufl.TestFunction(V), modulus, 0.3))
        u.append(own)
        bcs.append([clamp(V, plane(msh, 0, 0.0))])
        top = np.concatenate([plane(msh, 1, low + height), plane(msh, 0, length)])
        sides.append((qs.Surface(V, facets=plane(msh, 1, low)), qs.Surface(V, facets=top)))
    end = plane(u[0].function_space.mesh, 0, lengths[0])
    tags = mesh.meshtags(u[0].function_space.mesh, 1, end, np.ones_like(end))
    ds = ufl.Measure("ds", u[0].function_space.mesh, subdomain_data=tags)(1)
    load = fem.Constant(u[0].function_space.mesh, (0.0, force / height))
    F[0] += ufl.inner(load, ufl.TestFunction(u[0].function_space)) * ds
    joints = [qs.Contact(sides[i][0], sides[i + 1][1], **options) for i in range(2)]
    problem = qs.ContactProblem(F, u, joints, bcs)
    problem.solve()
    assert problem.num_iterations <= 25 + 60 * (options.get("sliding") == "finite")
    bent = np.array([[sagging(a, x) for x in lengths] for a in lengths])
    A = [[2 * bent[1, 1], -bent[2, 1]], [-bent[1, 2], 2 * bent[2, 2]]]
    beams = np.linalg.solve(A, [bent[0, 1], 0.0]) * force
    found = [contact.force("slave")[1] for contact in joints]
    assert found == pytest.approx(beams, rel=0.03 if "friction" in options else 0.02)


@pytest.mark.parametrize(
    ("gap", "options"),
    [
        (1e-3, {}),
        (2e-2, {}),
        (2e-2, FRICTION),
        (1e-2, {"sliding": "finite"}),
        pytest.param(2e-2, {"enforcement": "penalty"}, marks=pytest.mark.long),
        pytest.param(2e-2, FRICTION | {"sliding": "finite"}, marks=pytest.mark.long),
    ],
)
def test_leaves_with_a_clearance(gap, options):
    """A loaded leaf falls through a gap onto another one, and both bend, in one solve from rest."""
    height, length, modulus, load = 0.2, 10.0, 1e4, 0.05
    F, u, bcs, sides = [], [], [], []
    for low, n, weight in ((-height, 40, 0.0), (gap, 52, load)):
        msh = box(WORLD, (n, 2), "quadrilateral", [0.0, low], [length, low + height])
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        own, f = fem.Function(V), fem.Constant(msh, (0.0, -weight))
        F.append(elastic_form(own, ufl.TestFunction(V), modulus, 0.3, f))
        u.append(own)
        bcs.append([clamp(V, plane(msh, 0, 0.0))])
        side = low + height if weight == 0 else low
        facets = mesh.locate_entities_boundary(
            msh, 1, lambda x, side=side: np.isclose(x[1], side) & (x[0] > 0.4)
        )
        sides.append(qs.Surface(V, facets=facets))
    contact = qs.Contact(sides[1], sides[0], **options)
    problem = qs.ContactProblem(F, u, [contact], bcs)
    problem.solve()
    both = "friction" in options and "sliding" in options
    assert problem.num_iterations <= (60 if both else 40)
    # The force on both clamps is the load.
    total = -load * height * length
    for k, part in ((0, contact.force("master")[1]), (1, total - contact.force("master")[1])):
        held = bcs[k][0].dof_indices()[0]
        b = fem.assemble_vector(fem.form(F[k]))
        b.scatter_reverse(la.InsertMode.add)
        owned = held[held < num_owned(u[k])]
        found = WORLD.allreduce(float(b.array[owned[owned % 2 == 1]].sum()))
        assert found == pytest.approx(-part, rel=1e-6)
    assert contact.penetration() < 0.01 * length / 40


def num_owned(u):
    """Number of unknowns that this rank owns."""
    return u.function_space.dofmap.index_map.size_local * u.function_space.dofmap.index_map_bs


def sagging(at, x):
    """Deflection at x of a beam clamped at 0 under a force at a place, without its stiffness."""
    a, b = min(at, x), max(at, x)
    return a**2 * (3 * b - a) / 6
