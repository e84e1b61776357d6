"""Consistent masses of multipliers at points in the preconditioner of the saddle-point system."""

import numpy as np
import pytest
from linear.test_saddle import scene
from scenes import WORLD, largest

from qsdolfinx.system import consistent_mass
from qsdolfinx.system.row_blocks import RowBlocks

KINDS = ("points", "points, friction", "soft points", "finite")


def blocks(kind, cell="hexahedron"):
    """Blocks of the multipliers at the solution of a scene, with the problem that owns them."""
    _, problem = scene(cell, kind, "amg")
    problem.solve()
    equations = problem.equations()
    out = RowBlocks(equations)
    out.take(equations.evaluate(equations.first()))
    return out, problem


def waves(count):
    """This rank's part of an irregular vector that is the same on any partition."""
    first = WORLD.exscan(count) or 0
    return np.sin(1.3 * np.arange(first, first + count) + 1.0)


def iterations(kind, less):
    """Krylov iterations of a scene with this factor b, and the force."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(consistent_mass, "LESS_LUMPED", less)
        pair, problem = scene("hexahedron", kind, "amg")
        problem.solve()
        return problem.num_linear_iterations, pair.contact.force("slave")


@pytest.mark.parallel
@pytest.mark.parametrize("kind", KINDS)
def test_matrix(kind):
    """The inverse blocks as a matrix, which is condensed, are those of the preconditioner."""
    of, _problem = blocks(kind)
    matrix = of.inverse()
    x, y = matrix.createVecs()
    x.array[:] = waves(of.num_rows)
    matrix.mult(x, y)
    scale = of.scale[: of.num_rows]
    found = of.solve(scale * x.array_r)
    size = WORLD.allreduce(largest(found), op=max)
    assert largest(found - y.array_r) < 1e-13 * size
    assert largest(of.condensed(scale * x.array_r) + found) < 1e-13 * size


@pytest.mark.parallel
@pytest.mark.parametrize(("cell", "least"), (("hexahedron", 1 / 9), ("triangle", 1 / 3)))
def test_spectrum(cell, least):
    """b (I − Â) vanishes for a constant multiplier and is at most b (1 − the least mass)."""
    _, problem = scene(cell, "points", "amg")
    problem.solve()
    rows = [p.rows for p in problem.equations().passes]
    ends = np.cumsum([0, *(each.num_unknowns for each in rows)])
    count = int(ends[-1])
    mass = consistent_mass.ConsistentMass(problem.equations().passes, ends[:-1], count, WORLD)
    matrix = mass.scaled(np.ones(count), np.ones(count))
    roots, left = matrix.createVecs()
    roots.array[:] = np.sqrt(np.concatenate([each.condensed.areas[:, 0] for each in rows]))
    matrix.mult(roots, left)
    b = consistent_mass.LESS_LUMPED
    assert left.norm() < 1e-12 * b * roots.norm()
    roots.array[:] = waves(count)
    for _ in range(100):
        roots.normalize()
        matrix.mult(roots, left)
        largest_of_all = left.dot(roots)
        left.copy(roots)
    assert 0.5 * b < largest_of_all < 1.001 * b * (1 - least)


@pytest.mark.parametrize("kind", KINDS)
def test_fewer_iterations(kind):
    """Results are those with lumped masses, by a quarter fewer Krylov iterations."""
    (many, lumped), (few, found) = (iterations(kind, b) for b in (0.0, consistent_mass.LESS_LUMPED))
    assert few < 0.75 * many
    assert largest(found - lumped) < 1e-7 * largest(lumped)
