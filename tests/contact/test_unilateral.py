"""Unilateral contact: closing gaps, opening gaps, and hard cases for Newton's method."""

from mpi4py import MPI

import numpy as np
import pytest
from patch_bodies import E_MASTER, E_SLAVE, Body, Elastic, create_block
from scenes import CELLS, FORMULATIONS, WORLD, Pair, box, clamp, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import active_set


def blocks_with_gap(cell, formulation, load, penalty, gap=0.01):
    """Make the blocks of the patch test with a gap; the pressure load leaves the upper one free."""
    rng = np.random.default_rng(1)
    axis = 1 if cell in ("triangle", "quadrilateral") else 2
    lower, upper = (
        Body(create_block(WORLD, n, cell, z, z + 1, 0.2, rng), Elastic(E), z, z + 1)
        for n, z, E in ((6, 0.0, E_MASTER), (4, 1.0, E_SLAVE))
    )
    surfaces = [qs.Surface(block.V, facets=block.interface) for block in (upper, lower)]
    for block in (lower, upper):
        block.bcs += [block.slide(*side) for side in block.sides]
    lower.bcs.append(lower.slide(axis, lower.bottom))
    if load == "pressure":
        upper.press()
    else:
        upper.bcs.append(slide(upper.V, axis, upper.top, -2 * gap))
    upper.mesh.geometry.x[:, axis] += gap
    surfaces[0].update()
    contact = qs.Contact(*surfaces, formulation=formulation, law=qs.Unilateral(), penalty=penalty)
    u = [lower.u, upper.u]
    problem = qs.ContactProblem([lower.F, upper.F], u, [contact], [lower.bcs, upper.bcs])
    return contact, problem, axis


@pytest.mark.parametrize("penalty", ("auto", 3e7))
@pytest.mark.parametrize("load", ("pressure", "displacement"))
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_closing_a_gap(cell, formulation, load, penalty):
    contact, problem, axis = blocks_with_gap(cell, formulation, load, penalty)
    problem.solve()
    iterations = problem.snes.getIterationNumber()
    forces = contact.force("slave"), contact.force("master")
    active = WORLD.allreduce(active_set.num_closed(contact.model))
    assert iterations <= 8
    # Stress due to the prescribed displacement, for double-pass contact with its remaining gap.
    compliance = 1 / contact.penalty if contact.settings.enforcement == "penalty" else 0.0
    force = 65 if load == "pressure" else 0.01 / (1 / E_MASTER + 1 / E_SLAVE + compliance)
    assert np.isclose(forces[0][axis], force, rtol=1e-6)
    assert np.linalg.norm(forces[0] + forces[1]) < 1e-12 * force
    assert active > 0


def punch(formulation, penalty, load, gap):
    """Press a curved punch into a flat block in plane strain; only its upper face is held."""
    lower = box(WORLD, [40, 12], "quadrilateral", [-4.0, -4.0], [4.0, 0.0])
    upper = box(WORLD, [24, 8], "quadrilateral", [-3.0, 0.0], [3.0, 3.0])
    far = plane(upper, 1, 3.0)
    near = plane(upper, 1, 0.0)
    x = upper.geometry.x
    x[:, 1] += x[:, 0] ** 2 / 16 * (3 - x[:, 1]) / 3 + gap
    V = [vector_space(lower), vector_space(upper)]
    u = [fem.Function(space) for space in V]
    F = [elastic(f, E=200.0) for f in u]
    bcs = [[clamp(V[0], plane(lower, 1, -4.0))]]
    if load == "displacement":
        bcs.append([clamp(V[1], far, [0.0, -gap - 0.2])])
    else:
        bcs.append([slide(V[1], 0, far)])
        facets = np.sort(far)
        tags = mesh.meshtags(upper, 1, facets, np.ones(len(facets), dtype=np.int32))
        ds = ufl.Measure("ds", domain=upper, subdomain_data=tags)
        F[1] += 10 * ufl.TestFunction(V[1])[1] * ds(1)
    slave = qs.Surface(V[1], facets=near)
    master = qs.Surface(V[0], facets=plane(lower, 1, 0.0))
    contact = qs.Contact(
        slave,
        master,
        formulation=formulation,
        law=qs.Unilateral(),
        penalty=penalty,
        search_radius=2.0,
    )
    return contact, qs.ContactProblem(F, u, [contact], bcs)


@pytest.mark.parametrize("gap", (0.0, 0.3))
@pytest.mark.parametrize("load", ("pressure", "displacement"))
@pytest.mark.parametrize("penalty", (2e5, 2e8))
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_curved_punch(formulation, penalty, load, gap):
    """The contact zone grows from zero or one touching node, with penalties up to 1e6 E/h."""
    contact, problem = punch(formulation, penalty, load, gap)
    problem.solve()
    iterations = problem.snes.getIterationNumber()
    forces = contact.force("slave"), contact.force("master")
    gaps = [contact.weighted_gap()]
    if formulation == "double-pass":
        gaps.append(contact.weighted_gap("master"))
    penetration = WORLD.allreduce(max(np.nanmax(g, initial=0) for g in gaps), op=MPI.MAX)
    assert iterations <= 16
    if load == "pressure":
        assert np.isclose(forces[0][1], 60, rtol=1e-6)
    assert np.linalg.norm(forces[0] + forces[1]) < 1e-12 * np.linalg.norm(forces[0])
    assert penetration < 1e3 / penalty


def test_loading_and_unloading():
    """The load path does not matter: contact without friction has no memory."""
    options = {"contact_options": {"enforcement": "penalty"}}
    pair = Pair("quadrilateral", n=(9, 7), wave=0.05, load=0.0, **options)
    top = pair.bcs[1][0].g
    problem = pair.problem()
    energies = []
    for load in (-0.02, -0.1, -0.05, 0.3, -0.02):
        top.value[1] = load
        problem.solve()
        energies.append(pair.contact.stored_energy())
    assert energies[0] > 0 and energies[3] == 0
    assert np.isclose(energies[0], energies[4], rtol=1e-9)
