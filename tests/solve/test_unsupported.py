"""Warnings for bodies that rotate because only frictionless contact supports them."""

import warnings

import numpy as np
import pytest
from curved_scenes import Shell
from scenes import WORLD, box, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.solve.unsupported import check_unsupported


class Held:
    """A quarter of a ring, pressed on a rigid cylinder that touches its whole inner side."""

    def __init__(self, **options):
        self.ring = Shell((12, 2), (5.0, 10.0), degrees=("elevated", 1))
        tool = qs.RigidSurface.cylinder(WORLD, [0.0, 0.0], None, 5.0)
        self.ring.load(self.ring.outer, -ufl.SpatialCoordinate(self.ring.mesh) / 10.0)
        surface = self.ring.surface(self.ring.inner)
        options = {"search_radius": 2.0} | options
        contact = qs.Contact(surface, tool, **options)
        self.problem = qs.ContactProblem([self.ring.F], [self.ring.u], [contact], [[]])
        self.problem.solve()

    def warned_after(self, A):
        """Messages of the warnings if the last solve had moved the ring by A x. Collective."""
        system, V = self.problem.system, self.ring.u.function_space
        moved = self.ring.u.copy()
        moved.interpolate(lambda x: np.asarray(A) @ x[:2])
        size = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            check_unsupported(system, system.x.array_r - moved.x.array[:size])
        texts = [str(w.message) for w in caught]
        assert len(set(WORLD.allgather(tuple(texts)))) == 1
        return texts


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.1)))
def test_rotation_on_a_cylinder(friction):
    """Without friction, a rotation about the axis gives a warning.

    A small rotation and a strain give none, nor does any motion with friction.
    """
    case = Held(friction=friction)
    for A in ([[0.0, -0.001], [0.001, 0.0]], [[0.1, 0.0], [0.0, -0.1]]):
        assert case.warned_after(A) == []
    texts = case.warned_after([[0.0, -0.1], [0.1, 0.0]])
    assert len(texts) == (1 if friction is None else 0)
    assert all("hold its rotation" in text for text in texts)


def test_let_go_by_all():
    """A strip that a punch has bent over a roller springs back when the punch leaves.

    If contact forces have vanished, the remaining residual is compared with the earlier forces.
    """
    msh = box(WORLD, (40, 2), "quadrilateral", [0.0, 0.0], [4.0, 0.4])
    V = vector_space(msh)
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.neo_hookean(u, 400.0, 600.0), ufl.grad(v)) * ufl.dx
    lower, upper = (qs.Surface(V, facets=plane(msh, 1, y)) for y in (0.0, 0.4))
    roller = qs.RigidSurface.cylinder(WORLD, [3.0, -0.5], None, 0.5)
    punch = qs.RigidSurface.cylinder(WORLD, [0.0, 0.9], None, 0.5)
    options = {"sliding": "finite", "search_radius": 0.5}
    contacts = [qs.Contact(lower, roller, **options), qs.Contact(upper, punch, **options)]
    bcs = [slide(V, 0, plane(msh, 0, 0.0))]
    problem = qs.ContactProblem([F], [u], contacts, [bcs])
    counts = []
    for depth in (0.1, 0.2, 0.02, -0.01):
        punch.displacement = [0.0, -depth]
        for contact in contacts:
            contact.update()
        problem.solve()
        counts.append(problem.num_iterations)
        if depth > 0:
            assert contacts[1].force("master")[1] > 0
    assert counts[-1] <= 30 and max(abs(contacts[1].force("master"))) == 0.0


@pytest.mark.parametrize("enforcement", ("augmented-lagrangian", "penalty"))
def test_falls_to_its_support(enforcement):
    """A heavy, slender strip falls to its support when released by the punch that bent it."""
    msh = box(WORLD, (60, 2), "quadrilateral", [0.0, 0.0], [30.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    F = elastic(u, E=2e5, nu=0.3, force=ufl.as_vector((0.0, -0.01)))
    lower, upper = (qs.Surface(V, facets=plane(msh, 1, y)) for y in (0.0, 1.0))
    punch = qs.RigidSurface.cylinder(WORLD, [0.0, 4.0], None, 3.0)
    support = qs.RigidSurface.cylinder(WORLD, [20.0, -3.0], None, 3.0)
    above, below = (
        qs.Contact(surface, tool, enforcement=enforcement)
        for surface, tool in ((upper, punch), (lower, support))
    )
    problem = qs.ContactProblem([F], [u], [above, below], [[slide(V, 0, plane(msh, 0, 0.0))]])
    punch.displacement = [0.0, -0.2]
    problem.solve()
    assert above.force("master")[1] > 1.0
    punch.displacement = [0.0, 0.2]
    problem.solve()
    assert problem.num_iterations <= 15
    along, up = below.force("slave")
    np.testing.assert_allclose(up, 0.3, rtol=1e-7)
    assert abs(along) < 0.05 * up  # it does not lie on the top of the support only
    assert np.all(above.force("slave") == 0.0)
