"""Two leaves that bend on each other, clamped at one end: contact moves along the shorter leaf."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic_form, plane

import ufl
from dolfinx import fem, mesh

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
    lowered = float(WORLD.allreduce(-u.x.array.min()))
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
    assert iterations <= 20


def test_two_leaves_in_steps():
    """The first step has the same difficulties at any load: smaller steps do not help there."""
    found, iterations = tip(40, steps=4, **FRICTION)
    assert found == pytest.approx(1.0, abs=0.025)
    assert iterations[0] <= 20
    assert max(iterations[1:]) <= 3
