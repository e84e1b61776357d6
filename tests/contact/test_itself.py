"""Contact of a surface with itself."""

import pathlib

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, problem_of
from scenes import CELLS, WORLD, blocks, box, largest
from slotted import DEPTH, HEIGHT, LENGTH, ROOT, Slotted
from tangents import direction, near_solution, tangent_errors

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

FINITE = {"small": {"sliding": "small"}, "finite": {"sliding": "finite"}}
ENFORCEMENTS = {
    "penalty": {"enforcement": "penalty", "penalty": 1e3},
    "augmented": {"enforcement": "augmented-lagrangian", "penalty": 1e3, "gap_tolerance": 1e-12},
}


def pressed(scene, contact, down=(0.03, 0.06, 0.08), along=0.0, **options):
    """Return the forces on the body after the top has been moved down in steps."""
    problem = scene.problem(contact, **options)
    for step in down:
        scene.moved.value[:2] = along * step, -step
        problem.solve()
    return scene.body.internal_forces()


@pytest.mark.parametrize("enforcement", ENFORCEMENTS.values(), ids=ENFORCEMENTS)
@pytest.mark.parametrize("sliding", FINITE.values(), ids=FINITE)
@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)), ids=("smooth", "rough"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_as_two_surfaces(cell, friction, sliding, enforcement, monkeypatch):
    """Self-contact gives the result of two parts that are named by hand, if nothing else touches.

    There are two differences. A boundary in self-contact has no vertices at sharp edges. At points
    γ is that of all named facets.
    """
    monkeypatch.setattr("qsdolfinx.contact.making.has_creases", lambda *given: False)
    forces, results = [], []
    for make in (Slotted.itself, Slotted.of_two):
        scene = Slotted(cell, 0.05, n=(4, 5) if cell == "triangle" else (2, 3))
        options = {"search_radius": 0.3, "friction": friction} | sliding | enforcement
        if sliding["sliding"] == "small":
            options["constraints"] = "nodes"
        contact = make(scene, **options)
        forces.append(pressed(scene, contact, along=0.3))
        results.append([*contact.force("slave"), *contact.force("master"), contact.stored_energy()])
        assert np.abs(contact.force("slave")[1]) > 0.3
    size = largest(forces[1])
    limit = (1e-10 if sliding["sliding"] == "small" else 1e-2) * size
    assert largest(forces[0] - forces[1]) < limit
    np.testing.assert_allclose(*results, rtol=0, atol=limit)


@pytest.mark.parametrize("sliding", FINITE.values(), ids=FINITE)
@pytest.mark.parametrize(
    "cell, degree", [*((cell, 1) for cell in CELLS), ("triangle", 2), ("quadrilateral", 2)]
)
def test_closed_slit(cell, degree, sliding):
    """Stress passes through the non-matching faces of a closed slit as if it were not there."""
    scene = Slotted(cell, gap=0.0, degree=degree, n=(4, 5))
    body, pressure = scene.body, 10.0
    contact = scene.itself(scene.every, gap_tolerance=1e-12, **sliding)
    body.hold(0, 0, 0.0)
    body.hold(1, 1, -HEIGHT)
    if scene.gdim == 3:
        body.hold(2, 2, 0.0)
    body.press(1, HEIGHT, pressure)
    problem = scene.problem(contact)
    problem.solve()
    stress = fem.assemble_scalar(
        fem.form((body.P[1, 1] + pressure) ** 2 * ufl.dx(body.mesh, degree=4))
    )
    error = np.sqrt(WORLD.allreduce(stress) / (2 * HEIGHT * LENGTH * DEPTH ** (scene.gdim - 2)))
    assert error < 1e-10 * pressure
    assert WORLD.allreduce(contact.pairing.gap.size) > 0


@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_thin_wall(cell):
    """Faces opposite each other through the body are never paired, however close they are."""
    gdim = 2 if cell == "quadrilateral" else 3
    corners = [[0.0] * gdim, [1.0] * (gdim - 1) + [1e-3]]
    n = [8] * (gdim - 1) + [1]
    create = mesh.create_rectangle if gdim == 2 else mesh.create_box
    msh = create(WORLD, corners, n, mesh.CellType[cell])
    V = fem.functionspace(msh, ("Lagrange", 1, (gdim,)))
    every = mesh.locate_entities_boundary(msh, gdim - 1, lambda x: np.full(x.shape[1], True))
    surface = qs.Surface(V, facets=every)
    for sliding in ("small", "finite"):
        contact = qs.Contact(surface, surface, search_radius=0.3, sliding=sliding)
        assert WORLD.allreduce(contact.pairing.gap.size) == 0


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
def test_tangent(cell):
    scene = Slotted(cell, n=(4, 5) if cell == "triangle" else (2, 3))
    options = FINITE["small"] | ENFORCEMENTS["penalty"]
    contact = scene.itself(search_radius=0.3, friction=qs.Coulomb(0.3), **options)
    problem = scene.problem(contact, solver="direct")
    for down in (0.05, 0.12):
        scene.moved.value[1] = -down
        contact.update()
        problem.solve()
    x = near_solution(problem, np.random.default_rng(3), 1e-5)
    d = direction(problem, np.random.default_rng(4))
    assert tangent_errors(problem, x, d, 1e-7).difference < 1e-6


@pytest.mark.parametrize("depth", (0.05, 0.35))
def test_deep_in_each_other(depth):
    """A penetration below the thickness of an arm is found behind the face and pushed out."""
    scene = Slotted(n=(9, 11), gap=0.05)
    x = scene.mesh.geometry.x
    contact = scene.itself(search_radius=0.6, **ENFORCEMENTS["penalty"])
    upper = x[:, 1] > 0.04
    x[upper, 1] -= (0.05 + depth) * np.clip((x[upper, 0] - ROOT) / 0.3, 0, 1)
    contact.update()
    pairs = contact.pairing
    x = np.column_stack([pairs.slave.x[:, 0], pairs.master.x[:, 0]])
    beyond = np.all(x > ROOT + 0.35, axis=1)  # in the straight part of the upper arm
    assert WORLD.allreduce(int(np.count_nonzero(beyond))) > 20
    np.testing.assert_allclose(pairs.gap[beyond], -depth, atol=1e-9)
    # All of the straight part is paired, from either half.
    weight = WORLD.allreduce(float(pairs.weight[beyond].sum()))
    assert weight > 0.95 * (LENGTH - ROOT - 0.35) - 0.1
    assert contact.penetration() > 0.99 * depth


@pytest.mark.parametrize("depth", (0.05, 0.3))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_depth_at_a_tip(cell, depth):
    """A slanted arm is deepest at its tip: the depth is measured near the ends of long facets."""
    scene = Slotted(cell, n=(3, 2) if cell == "triangle" else (2, 2), gap=0.05)
    contact = scene.itself(search_radius=0.6, **ENFORCEMENTS["penalty"])
    x = scene.mesh.geometry.x
    upper = x[:, 1] > 0.04
    x[upper, 1] -= (0.05 + depth) * np.clip((x[upper, 0] - ROOT) / (LENGTH - ROOT), 0, 1)
    contact.update()
    assert 0.96 * depth < contact.penetration() <= depth * (1 + 1e-9)


def test_turned_inside_out():
    """A boundary that crosses itself within a cell has no inside, and is refused."""
    scene = Slotted(gap=0.05)
    x = scene.mesh.geometry.x
    surface = scene.body.surface(scene.every)
    corner = np.isclose(x[:, 0], LENGTH) & np.isclose(x[:, 1], HEIGHT + 0.05)
    x[corner, 0] -= 0.9
    with pytest.raises(ValueError, match=r"turned inside out|degenerate"):
        surface.update()
        qs.Contact(surface, surface)


def test_forces_of_all_the_body():
    """Tractions are those of both parts; they act on the body as internal forces."""
    scene = Slotted(n=(6, 6))
    contact = scene.itself(search_radius=0.3, **ENFORCEMENTS["penalty"])
    pressed(scene, contact)
    traction = contact.slave.node_values(contact.traction("slave"))
    lower = contact.slave.node_x[:, 1] < 0.05
    forces = traction * contact.slave.node_area[:, None]
    of_parts = [WORLD.allreduce(forces[part].sum(axis=0)) for part in (lower, ~lower)]
    size = np.abs(contact.force("slave")[1])
    np.testing.assert_allclose(of_parts[0], -of_parts[1], atol=1e-10 * size)
    np.testing.assert_allclose(of_parts[0], contact.force("slave")[:2], atol=1e-10 * size)


def test_what_is_refused():
    scene = Slotted()
    surface = scene.body.surface(scene.every)
    again = scene.body.surface(scene.every)
    for options, message in (
        ({"formulation": "double-pass"}, "roles to pairs"),
        ({"quadrature": "nodal"}, "quadrature"),
        ({"law": qs.Tied()}, "cannot be tied"),
    ):
        with pytest.raises(ValueError, match=message):
            qs.Contact(surface, surface, **options)
    with pytest.raises(ValueError, match="give the same Surface"):
        qs.Contact(surface, again)


def test_where_it_touches(tmp_path):
    """The report and the fields show both parts."""
    scene = Slotted(n=(6, 7), gap=0.05)
    contact = scene.itself(scene.every, search_radius=0.3, friction=qs.Coulomb(0.1))
    pressed(scene, contact)
    low, high = contact.report().touching
    assert ROOT < high[0] < 1.05 * LENGTH and low[0] > ROOT - 0.05  # nodes beside points
    assert -0.1 < low[1] <= high[1] < 0.05
    assert "from (" in str(contact.report())
    status = contact.status("master")
    x = status.function_space.tabulate_dof_coordinates()
    closed = status.x.array >= 2
    for y in (0.0, scene.gap):
        assert WORLD.allreduce(int(np.sum(closed & np.isclose(x[:, 1], y)))) > 2
    assert not np.any(closed & (np.abs(x[:, 1]) > 0.1))
    folder = pathlib.Path(WORLD.bcast(str(tmp_path), root=0))
    writer = qs.FieldWriter(folder / "slot.xdmf", scene.mesh, contact.fields("slave"))
    writer.write(0.0)
    writer.close()


@pytest.mark.parametrize("overlap", (0.0, 1e-15, 1e-9, 1e-4, 0.03, -0.02))
@pytest.mark.parametrize("gdim", (2, 3))
def test_parts_that_overlap_at_first(gdim, overlap):
    """Parts that overlap initially are not walls of each other, at any depth, also after moving."""
    high, up = np.ones(gdim), np.eye(gdim)[-1] * (1 - overlap)
    msh = blocks((0 * high, high), (up, high + up))
    V = fem.functionspace(msh, ("Lagrange", 1, (gdim,)))
    every = mesh.locate_entities_boundary(msh, gdim - 1, lambda x: np.full(x.shape[1], True))
    surface = qs.Surface(V, facets=every)
    x = msh.geometry.x.copy()
    upper = np.zeros(len(x), dtype=bool)
    for cell in msh.geometry.dofmap:
        upper[cell] = x[cell, gdim - 1].mean() > 1
    contact = qs.Contact(surface, surface, search_radius=0.2)
    for pressed_in in (0.0, 0.01, 0.05):
        msh.geometry.x[upper, gdim - 1] = x[upper, gdim - 1] - pressed_in
        contact.update()
        gap, weight = contact.pairing.gap, contact.pairing.weight
        assert abs(WORLD.allreduce(np.sum(weight)) - 1) < 1e-12
        assert WORLD.allreduce(float(np.max(np.abs(gap + overlap + pressed_in), initial=0))) < 1e-12


def test_overlap_is_refused():
    """Overlap is refused as with two surfaces."""
    msh = blocks(([0.0, 0.0], [1.0, 1.0]), ([0.0, 0.97], [1.0, 2.0]))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    every = mesh.locate_entities_boundary(msh, 1, lambda x: np.full(x.shape[1], True))
    surface = qs.Surface(V, facets=every)
    with pytest.raises(ValueError, match=r"penetrate each other by 0\.03"):
        qs.Contact(surface, surface, initial_overclosure="error")


def hairpin(comm, sliding, partition=None):
    """Return results of a closed hairpin, with meshes on some of the ranks."""
    msh = box(comm, (36, 2), "quadrilateral", [0, 0], [1, 1], partition)
    x = msh.geometry.x
    s, t = 2 * x[:, 0] - 1, 0.8 + 0.2 * x[:, 1]
    leg = np.maximum(np.abs(s) - 0.4, 0) * np.where(s > 0, 4, 5)
    angle = np.pi / 2 * np.clip(s / 0.4, -1, 1)
    x[:, 0], x[:, 1] = leg - t * np.cos(angle), t * np.sin(angle)
    body = Body(msh)
    ends = [body.boundary(lambda x, y=y: np.isclose(x[1], y) & (x[0] > 1.4)) for y in (1, -1)]
    moved = body.clamp(ends[0])
    body.clamp(ends[1])
    surface = body.surface(body.boundary(lambda x: np.full(x.shape[1], True)))
    options = {"search_radius": 1.7, "friction": qs.Coulomb(0.1), "enforcement": "penalty"}
    contact = qs.Contact(surface, surface, **options, **sliding)
    problem = problem_of([body], [contact], solver="direct")
    out = []
    for down in (0.8, 1.4, 1.58, 1.62):
        moved.value[1] = -down
        problem.solve()
        out += [*contact.force("slave"), *contact.force("master"), contact.stored_energy()]
        out += [contact.penetration(), *contact.moment("slave", np.zeros(2))]
    points = contact.pairing
    out += [comm.allreduce(float(points.weight @ points.gap)), contact.step_dissipation()]
    return np.array(out)


@pytest.mark.parametrize("partition", ("scattered", "last"))
@pytest.mark.parametrize("sliding", FINITE.values(), ids=FINITE)
def test_same_on_all_ranks(sliding, partition):
    """Results do not depend on ranks: pairs span ranks, or only one rank has facets."""
    alone, together = hairpin(MPI.COMM_SELF, sliding), hairpin(WORLD, sliding, partition)
    assert np.abs(alone).max() > 1
    assert largest(together - alone) < 1e-9 * np.abs(alone).max()
