"""Values on contact surfaces: integrals that the overlay of old and new facets preserves."""

import types

import numpy as np
import pytest
from forming_bodies import quarter_cylinder
from remeshing_scenes import bump, tagged
from scenes import WORLD, Pair, drag_top, gathered, plane, vector_space

from dolfinx import mesh

import qsdolfinx as qs
from qsdolfinx.remeshing import contact_values
from qsdolfinx.remeshing.contact_values import ContactValues
from qsdolfinx.remeshing.surface_values import SurfaceValues

pytest.importorskip("gmsh")


def surfaces(dim, axisymmetric=False):
    """Surfaces at the top of a body on two meshes."""
    if dim == 2:
        meshes = [mesh.create_rectangle(WORLD, [[0, 0], [2, 1]], [n, 2]) for n in (7, 10)]
    else:
        meshes = [mesh.create_unit_cube(WORLD, n, n, 2) for n in (3, 5)]
    return [
        qs.Surface(vector_space(m), facets=plane(m, dim - 1, 1.0), axisymmetric=axisymmetric)
        for m in meshes
    ]


def total(surface, values):
    return WORLD.allreduce((surface.node_area[:, None] * values).sum(axis=0))


@pytest.mark.parametrize(("dim", "axisymmetric"), [(2, False), (2, True), (3, False)])
def test_integrals_are_kept_to_rounding(dim, axisymmetric):
    old, new = surfaces(dim, axisymmetric)
    x = old.node_x
    values = np.column_stack([np.exp(x[:, 0]), x[:, 0] < 0.4, x[:, 1] ** 3, 1 + 0 * x[:, 0]])
    found = SurfaceValues.of(old, values).on(new)
    assert np.allclose(total(new, found), total(old, values), rtol=1e-12)
    assert np.allclose(found[:, 3], 1) and np.all((found[:, 1] >= -1e-14) & (found[:, 1] <= 1.0001))


@pytest.mark.parametrize("dim", [2, 3])
def test_same_surface_keeps_its_values(dim):
    old, _ = surfaces(dim)
    again = qs.Surface(old.V, facets=old.facets)
    values = np.random.default_rng(WORLD.rank).uniform(size=(len(old.node_area), 2))
    assert np.array_equal(SurfaceValues.of(old, values).on(again), values)


def test_curved_surface():
    """On a curved surface integrals are kept approximately.

    New nodes lie on the old facets, and new facets are chords, so areas differ.
    """
    msh = quarter_cylinder(WORLD, 10.0, 0.0, 6.0, 1.5)
    tags = tagged(msh, [(0, 0.0), (1, 0.0), (2, 0.0), (2, 6.0)])
    bump(msh, 0.3, 6.0)
    made = qs.remesh(msh, 1.5, tags)
    old, new = (
        qs.Surface(vector_space(m), t, 4) for m, t in ((msh, tags), (made.mesh, made.facet_tags))
    )
    values = np.exp(-old.node_x[:, :1] / 5)
    kept = total(old, values)
    found = SurfaceValues.of(old, values).on(new)
    assert np.allclose(total(new, found), kept, rtol=3e-3)
    assert np.allclose(found[:, 0], np.exp(-new.node_x[:, 0] / 5), atol=0.15)


@pytest.mark.parallel
@pytest.mark.parametrize("constraints", ("nodes", "points"))
def test_multipliers_do_not_depend_on_the_partition(constraints):
    """Multipliers are scaled to the forces of all ranks, not to those of each rank."""
    options = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
    options["constraints"] = constraints
    kept, found = None, []
    for n, partition in ((12, "scattered"), (17, "scattered"), (17, "backward")):
        partitions = "forward", partition
        pair = Pair("triangle", n=(5, n), partitions=partitions, contact_options=options)
        drag_top(pair, 0.2)
        model, problem = pair.contact.model, pair.problem()
        if kept is None:
            problem.solve()
            kept = ContactValues.of(model)
            continue
        problem.set_up()
        kept.hand_over(model)
        values = model.parts[0].augmented_on_nodes()
        x, values = (gathered(WORLD, of) for of in (pair.slave.node_x, values))
        found.append(values[np.argsort(x[:, 0])])
    assert np.abs(found[0]).max() > 0.01
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)


@pytest.mark.parametrize("factor, expected", ((1.2, 1.2), (0.8, 0.8), (5.0, 1.0)))
def test_moderate_corrections(monkeypatch, factor, expected):
    """Multipliers are scaled to their integral, unless that is one over another area."""
    for name in ("of_nodes", "of_contact"):
        monkeypatch.setattr(contact_values.memory, name, lambda model: [])
    monkeypatch.setattr(contact_values.multipliers, "turn", lambda parts: None)
    gap = types.SimpleNamespace(
        multiplier_weight=np.ones((4, 1)),
        state=types.SimpleNamespace(augmented=np.ones((4, 1))),
        slave=types.SimpleNamespace(comm=WORLD),
    )
    total = np.array([4.0 * WORLD.size * factor])
    ContactValues({}, {}, [total]).hand_over(types.SimpleNamespace(gaps=[gap], parts=[gap]))
    np.testing.assert_allclose(gap.state.augmented, expected)
