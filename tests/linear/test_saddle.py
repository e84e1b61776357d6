"""Unknowns and multipliers from one linear system, where a preset with multigrid allows it."""

import itertools

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, drag_top, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import active_set
from qsdolfinx.linear import saddle, solver
from qsdolfinx.solve import primal_dual

AUGMENTED = "augmented-lagrangian"


def scene(cell, law, solver, wave=0.02, partitions=("forward", "backward"), **options):
    pair = Pair(
        cell, n=(5, 4) if cell == "hexahedron" else (8, 6), wave=wave, partitions=partitions
    )
    pair.contact = qs.Contact(pair.slave, pair.master, law=law(), enforcement=AUGMENTED, **options)
    if law is qs.Tied:
        drag_top(pair, 0.02)
    return pair, pair.problem(solver=solver)


def used(monkeypatch):
    """Numbers of iterations of the systems that are solved, in a list that grows."""
    counts, solve = [], saddle.SaddlePoint.solve

    def counted(self, *args):
        out = solve(self, *args)
        counts.append(self.num_iterations)
        return out

    monkeypatch.setattr(saddle.SaddlePoint, "solve", counted)
    return counts


def same(pair, other, rtol=1e-6):
    for u, v in zip(pair.u, other.u, strict=True):
        assert largest(u.x.array - v.x.array) < rtol * largest(v.x.array)
    for name in ("slave", "master"):
        np.testing.assert_allclose(
            pair.contact.force(name), other.contact.force(name), rtol=rtol, atol=1e-7
        )


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_as_the_direct_solver(monkeypatch, cell, law, quadrature):
    """The same solution, with gaps closed, by fewer iterations than Uzawa's method takes."""
    reference, direct = scene(cell, law, "direct", quadrature=quadrature)
    direct.solve()
    counts = used(monkeypatch)
    pair, problem = scene(cell, law, "amg", quadrature=quadrature)
    problem.solve()
    same(pair, reference)
    assert pair.contact.violation() <= pair.contact.allowed_gap
    if law is qs.Unilateral:  # the active set changes on the way
        assert problem.num_augmentations == 1 < len(counts)
        return
    assert problem.num_augmentations == len(counts) == 1
    together = problem.num_linear_iterations
    monkeypatch.setattr(solver.LinearSolver, "has_saddle_point", property(lambda self: False))
    _, uzawa = scene(cell, law, "amg", quadrature=quadrature)
    uzawa.solve()
    assert together < uzawa.num_linear_iterations


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("partitions", (("first", "last"), ("scattered", "forward")))
def test_partitions(monkeypatch, partitions, law):
    """Each body on a rank of its own, and with 3 ranks one without any; or cells dealt out."""
    reference, direct = scene("triangle", law, "direct", partitions=partitions)
    direct.solve()
    counts = used(monkeypatch)
    pair, problem = scene("triangle", law, "amg", partitions=partitions)
    problem.solve()
    assert len(counts) == 1 if law is qs.Tied else counts
    same(pair, reference)


def test_given_up(monkeypatch):
    """Uzawa's method goes on where the system cannot be solved."""
    reference, direct = scene("triangle", qs.Unilateral, "direct", wave=0.0)
    direct.solve()
    monkeypatch.setattr(saddle, "MAX_ITERATIONS", 1)
    counts = used(monkeypatch)
    pair, problem = scene("triangle", qs.Unilateral, "amg", wave=0.0)
    problem.solve()
    assert set(counts) == {1} and problem.num_augmentations > 1
    same(pair, reference)


def test_more_iterations_than_vectors(monkeypatch):
    """Where the Krylov space is full, another system goes on from there."""
    reference, direct = scene("triangle", qs.Tied, "direct")
    direct.solve()
    monkeypatch.setattr(saddle, "MAX_ITERATIONS", 8)
    counts = used(monkeypatch)
    pair, problem = scene("triangle", qs.Tied, "amg")
    problem.solve()
    assert problem.num_augmentations == 1 < len(counts)
    same(pair, reference)


def test_sets_that_take_turns(monkeypatch):
    """Uzawa's method goes on where active sets come back."""
    reference, direct = scene("triangle", qs.Unilateral, "direct")
    direct.solve()
    turns = itertools.cycle((b"one", b"other"))
    monkeypatch.setattr(primal_dual.PrimalDual, "digest", lambda self: next(turns))
    counts = used(monkeypatch)
    pair, problem = scene("triangle", qs.Unilateral, "amg")
    problem.solve()
    assert len(counts) == 4  # twice inexact, twice exact
    same(pair, reference)


def test_matrix(monkeypatch):
    """Its product is the derivative of both residuals, by finite differences of the whole."""
    pair, problem = scene("triangle", qs.Unilateral, "amg", wave=0.0)
    found = []

    class Checked(saddle.SaddlePoint):
        def solve(self, residual, *args):
            p = pair.contact.model.gaps[0]
            closed = active_set.slope(pair.contact.model, p) > 0
            x0, known = problem.system.x.array.copy(), p.state.augmented.copy()
            free = np.concatenate([np.isin(np.arange(b.num_owned), b.free) for b in problem.bodies])
            dx = np.where(free, np.sin(1.3 * np.arange(len(x0))), 0.0)
            dl = np.where(closed[:, None], np.cos(np.arange(len(closed)))[:, None], 0.0)

            def both(t):
                p.state.augmented = known + 1e-3 * t * dl
                R = problem.system.residual(x0 + 1e-6 * t * dx)
                rows = (p.multiplier(pair.contact.eps) - p.state.augmented)[closed, 0]
                return np.concatenate([R, p.weight[closed] * rows])

            difference = both(1.0) - both(0.0)
            p.state.augmented = known
            problem.system.residual(x0)
            x = np.concatenate([1e-6 * dx, 1e-3 * dl[closed, 0]])
            vec = PETSc.Vec().createWithArray(x, comm=WORLD)
            y = vec.duplicate()
            self.mult(None, vec, y)
            masked = np.concatenate([free, np.ones(closed.sum(), dtype=bool)])
            error = np.abs(np.where(masked, y.array_r - difference, 0.0))
            found.append((largest(error), largest(y.array_r)))
            return super().solve(residual, *args)

    monkeypatch.setattr(solver, "SaddlePoint", Checked)
    problem.solve()
    assert found
    for error, size in found:
        assert error < 1e-6 * size


def test_rigid_tool_and_three_bodies(monkeypatch):
    """Contacts of one problem are closed together; a rigid tool is one of them."""
    counts, forces = used(monkeypatch), []
    for name in ("direct", "amg"):
        meshes = [
            box(WORLD, n, "quadrilateral", [0.0, low], [1.0, low + 1.0])
            for n, low in (((6, 5), 0.0), ((5, 4), 1.0))
        ]
        u = [fem.Function(vector_space(msh)) for msh in meshes]
        F = [elastic(u_i, E) for u_i, E in zip(u, (1.0, 3.0), strict=True)]
        sides = [
            qs.Surface(u_i.function_space, facets=plane(msh, 1, z))
            for u_i, msh, z in (
                (u[0], meshes[0], 1.0),
                (u[1], meshes[1], 1.0),
                (u[1], meshes[1], 2.0),
            )
        ]
        bottom = clamp(u[0].function_space, plane(meshes[0], 1, 0.0))
        tool = qs.RigidSurface.plane(WORLD, (0.5, 2.0), (0.0, -1.0))
        contacts = [
            qs.Contact(sides[1], sides[0], law=qs.Tied(), enforcement=AUGMENTED),
            qs.Contact(sides[2], tool, enforcement=AUGMENTED),
        ]
        tool.displacement = (0.0, -0.02)
        problem = qs.ContactProblem(F, u, contacts, [[bottom], []], solver=name)
        problem.solve()
        forces.append([c.force("slave") for c in contacts])
        assert all(c.violation() <= c.allowed_gap for c in contacts)
    assert counts
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-6, atol=1e-9)
