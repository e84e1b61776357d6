"""Overlay quadrature: areas, exactness on any meshes, traces of degree 2, partial cover."""

from mpi4py import MPI

import numpy as np
import pytest
from patch_test import Parameters, run
from scenes import (
    CELLS,
    FORMULATIONS,
    WORLD,
    Pair,
    box,
    clamp,
    elastic,
    plane,
    spread_cells,
    vector_space,
)

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import terms

ERRORS = ("slave_max_error", "master_max_error", "slave_nodal_max_error", "master_nodal_max_error")
EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}


def quadratic_space(msh):
    return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))


@pytest.mark.parallel
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("master, slave", ((16, 5), (5, 16), (7, 4)))
def test_patch_test_is_exact(cell, master, slave):
    for load, contact, jitter in (
        ("pressure", "tied", 0.3),
        ("displacement", "unilateral", 0.3),
        ("pressure", "unilateral", 0.0),
    ):
        p = Parameters(master, slave, cell, jitter, 2, load=load, contact=contact, **EXACT)
        result, _ = run(p)
        assert max(result[key] for key in ERRORS) < 2e-8, (load, contact)
        assert result["force_imbalance"] < 1e-12


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_every_formulation_is_exact(cell, formulation):
    multipliers = [] if formulation == "double-pass" else ["augmented-lagrangian"]
    for enforcement in ("penalty", *multipliers):
        p = Parameters(7, 4, cell, 0.25, 3, formulation, **EXACT | {"enforcement": enforcement})
        result, _ = run(p)
        assert max(result[key] for key in ERRORS) < 1e-9, enforcement


@pytest.mark.parametrize("contact", ("tied", "unilateral"))
@pytest.mark.parametrize("cell", CELLS)
def test_tilted_interface(cell, contact):
    for angle, load in ((33.0, "pressure"), (-70.0, "displacement")):
        p = Parameters(6, 4, cell, 0.25, 4, load=load, contact=contact, rotate=angle, **EXACT)
        result, _ = run(p)
        assert max(result[key] for key in ERRORS) < 1e-9, angle


@pytest.mark.parametrize("cell", CELLS)
def test_overhang(cell):
    """With partial cover forces balance, and slave parts with nothing opposite have none."""
    p = Parameters(6, 4, cell, 0.0, overhang=0.3, contact="unilateral", **EXACT)
    result, contact = run(p)
    surface = contact.slave
    local = surface.node_dofs - surface.V.dofmap.index_map.local_range[0] * surface.gdim
    traction = contact.traction("slave").x.array[local]
    free = surface.node_x[:, 0] > 1.0 + 1 / 4 - 1e-9  # all of the support is beyond the master
    force = contact.force("slave")[-1]
    assert np.all(traction[free] == 0)
    assert np.isclose(force, 65, rtol=1e-9)
    assert result["force_imbalance"] < 1e-12


@pytest.mark.parametrize("contact", ("tied", "unilateral"))
@pytest.mark.parametrize("cell", CELLS)
def test_ranks_do_not_matter(cell, contact, monkeypatch):
    p = Parameters(
        5, 3, cell, 0.2, 1, "quasi-symmetric", "displacement", contact, 1e5, "overlay", overhang=0.2
    )
    expected, _ = run(p, MPI.COMM_SELF)
    results = [run(p)[0]]
    for partition in ("scattered", "last"):
        with spread_cells(monkeypatch, partition):
            results.append(run(p)[0])
    for result in results:
        for name in (*ERRORS, "gap_max"):
            assert np.isclose(result[name], expected[name], rtol=1e-9, atol=0), name


def surfaces(cell, n=(7, 4), shift=0.0, wave=0.0, spaces=(vector_space, vector_space)):
    pair = Pair(cell, n=n, wave=wave)
    out = []
    for msh, space, low in zip(pair.meshes, spaces, (-1, 0), strict=True):
        facets = np.concatenate([pair.master.facets, pair.slave.facets][low + 1 : low + 2])
        if low == 0:
            msh.geometry.x[:, 0] += shift
        out.append(qs.Surface(space(msh), facets=facets))
    return out[::-1]


@pytest.mark.parametrize("cell", CELLS)
def test_areas(cell):
    """The covered area is exact, and nothing is counted twice."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    for shift in (0.0, 0.2345):
        slave, master = surfaces(cell, shift=shift)
        for formulation in ("master-slave", "quasi-symmetric"):
            contact = qs.Contact(
                slave,
                master,
                formulation=formulation,
                law=qs.Tied(),
                penalty=1.0,
                quadrature="overlay",
            )
            area = WORLD.allreduce(contact.pairing.weight.sum())
            assert np.isclose(area, 1 - shift, rtol=1e-12, atol=0), gdim


@pytest.mark.parametrize("cell", CELLS)
def test_areas_of_curved_surfaces(cell):
    """Covered and uncovered parts of wavy facets add up to the area of the slave."""
    slave, master = surfaces(cell, n=(9, 6), wave=0.1)
    contact = qs.Contact(
        slave, master, formulation="master-slave", law=qs.Tied(), penalty=1.0, quadrature="overlay"
    )
    covered = WORLD.allreduce(contact.pairing.weight.sum())
    area = slave.area
    # At the rim the projections of tilted facets do not cover each other completely.
    assert covered <= area * (1 + 1e-12)
    assert covered > 0.97 * area


@pytest.mark.parametrize("cell", CELLS)
def test_pairing_points(cell):
    slave, master = surfaces(cell, n=(6, 5), wave=0.05)
    contact = qs.Contact(slave, master, law=qs.Tied(), penalty=1.0, quadrature="overlay")
    p = contact.pairing
    for side in (p.slave, p.master):
        np.testing.assert_allclose(side.shape_values.sum(axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(p.multiplier_values.sum(axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(p.normal, axis=1), 1, rtol=1e-12)
    gap = np.sum((p.master.x - p.slave.x) * p.normal, axis=1)
    np.testing.assert_allclose(p.gap, gap, atol=2e-4)  # points are paired along facet normals


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("cell", CELLS)
def test_quadratic_displacement(cell, law):
    """The patch test passes with P2 or Q2 on both sides, and on one side only."""
    for spaces in ((quadratic_space, quadratic_space), (quadratic_space, vector_space)):
        pair = Pair(cell, law=law(), n=(5, 3))
        u, V, F, bcs, faces = [], [], [], [], []
        for i, (msh, space) in enumerate(zip(pair.meshes, spaces, strict=True)):
            V.append(space(msh))
            u.append(fem.Function(V[i]))
            F.append(elastic(u[i], E=1.0 + i, nu=0.0))
            far = plane(msh, pair.gdim - 1, -1.0 if i == 0 else 1.0)
            value = np.zeros(pair.gdim)
            value[-1] = 0.0 if i == 0 else -0.1
            bcs.append([clamp(V[i], far, value)])
            faces.append(qs.Surface(V[i], facets=(pair.master, pair.slave)[i].facets))
        contact = qs.Contact(
            faces[1],
            faces[0],
            law=law(),
            quadrature="overlay",
            enforcement="augmented-lagrangian",
            gap_tolerance=1e-12,
        )
        problem = qs.ContactProblem(F, u, [contact], bcs)
        problem.solve()
        pressure = 0.1 / (1 / 1.0 + 1 / 2.0)
        for side, sign in (("slave", 1), ("master", -1)):
            surface = (contact.slave if side == "slave" else contact.master).linear
            found = surface.node_values(contact.traction(side))
            expected = np.zeros(pair.gdim)
            expected[-1] = sign * pressure
            np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), atol=1e-9)
            force = contact.force(side)
            np.testing.assert_allclose(force[-1], sign * pressure, rtol=1e-9)


def test_quadrilaterals_that_fold_in_projection():
    """Sides of a warped block projected onto one beside it: facets that fold are left out.

    Formerly the map to the plane of such a facet was inverted: weights were negative, and forces
    were not in balance.
    """
    faults = []
    for seed in range(12):
        surfaces = []
        for low in (0.0, 1.02):
            msh = box(WORLD, (2, 2, 1), "hexahedron", [0, 0, low], [1, 1, low + 1])
            msh.topology.create_connectivity(2, 3)
            facets = mesh.exterior_facet_indices(msh.topology)
            x = msh.geometry.x
            waves = np.random.default_rng([seed, int(low)]).normal(size=(3, 3)) * 9
            x += 0.05 * np.sin(x @ waves)
            surfaces.append(qs.Surface(vector_space(msh), facets=facets))
        contact = qs.Contact(
            *surfaces,
            formulation="master-slave",
            penalty=1.0,
            quadrature="overlay",
            search_radius=1.0,
        )
        p = contact.pairing
        u = [s.create_vec() for s in surfaces]
        u[1].array[2::3] = 0.1  # the upper body is the master, and it moves away
        u[0].array[2::3] = 0.3
        terms.evaluate(contact.model, *u)
        forces = contact.force("slave"), contact.force("master")
        ones = [np.abs(s.shape_values.sum(axis=1) - 1) for s in (p.slave, p.master)]
        faults.append(max(e.max(initial=0.0) for e in ones))
        faults.append(-p.weight.min(initial=0.0))
        faults.append(np.abs(forces[0] + forces[1]).max() / np.abs(forces[0]).max())
    assert WORLD.allreduce(max(faults), op=MPI.MAX) < 1e-9
