"""Test that the auditor finds faults planted in a state, and none in the state itself."""

import dataclasses
import itertools

import numpy as np
import pytest
from audit.scenes import HISTORIES, Stage, random_scene
from audit.state import assemble_surface, read_surface
from scenes import WORLD, box, plane

from dolfinx import fem

PLAIN = dataclasses.replace(
    random_scene(0),
    gdim=2,
    cells=("quadrilateral", "quadrilateral"),
    n=((6, 4), (5, 3)),
    degree=1,
    tool="none",
    large=False,
    loaded=False,
    dragged=False,
    symmetric=False,
    swapped=False,
    curvature=0.0,
    wave=0.0,
    gap=0.0,
    depth=0.01,
    slide=0.05,
    ratio=1.0,
    nu=0.3,
    history="press, slide",
    tied=False,
    mu=0.2,
    stiff=100.0,
    options={"formulation": "master-slave", "quadrature": "nodal", "enforcement": "penalty"},
    solver="direct",
    E=3.0,
    L=2.0,
)
OVERLAY = {
    "formulation": "quasi-symmetric",
    "quadrature": "overlay",
    "enforcement": "penalty",
    "constraints": "nodes",
}
SOLID = {
    "gdim": 3,
    "cells": ("hexahedron", "tetrahedron"),
    "n": ((3, 3, 2), (2, 2, 2)),
    "options": OVERLAY | {"enforcement": "augmented-lagrangian"},
    "stiff": None,
}
KINDS = {
    "node by node": PLAIN,
    "overlay": dataclasses.replace(PLAIN, options=OVERLAY),
    "3D, degree 2": dataclasses.replace(PLAIN, degree=2, **SOLID),
    "loaded": dataclasses.replace(PLAIN, loaded=True, history="press", mu=0.0),
    "tied": dataclasses.replace(PLAIN, tied=True, mu=0.0, options=OVERLAY),
    "sphere": dataclasses.replace(PLAIN, tool="sphere", curvature=0.3, depth=0.03),
    "large": dataclasses.replace(PLAIN, large=True, depth=0.04),
    "tied across a gap": dataclasses.replace(PLAIN, tied=True, mu=0.0, gap=0.3, options=OVERLAY),
    "dragged": dataclasses.replace(PLAIN, dragged=True),
    "plane": dataclasses.replace(PLAIN, tool="plane", mu=0.0, curvature=0.3),
}


class Solved:
    """A scene after its last step, not yet audited; its states are read once and may be changed."""

    def __init__(self, scene):
        self.stage = stage = Stage(scene)
        *first, last = HISTORIES[scene.history]
        for step in (*first, last):
            stage.move(*step)
            stage.problem.solve()
            stage.read_settings()
            self.before = list(stage.auditor.before)
            self.states = stage.auditor.read()
            self.right = stage.auditor.audit()

    @property
    def slave(self):
        """Return the index of the body and its surface."""
        return self.stage.joint.slave[0], self.stage.auditor.surfaces[0][0]

    def names(self, plant):
        """Return the audits that detect a fault planted in copies of the states."""
        auditor = self.stage.auditor
        states = [dataclasses.replace(s, u=s.u.copy(), force=s.force.copy()) for s in self.states]
        plant(self, states)
        auditor.before, read, auditor.read = list(self.before), auditor.read, lambda: states
        try:
            return {fault.check for fault in auditor.audit()}
        finally:
            auditor.read = read


def loaded_node(solved, states):
    """Return the slave node with the largest force, and this force."""
    i, surface = solved.slave
    force = states[i].force[surface.nodes]
    node = surface.nodes[np.argmax(np.linalg.norm(force, axis=1))]
    return states[i].force[node]


def flip(solved, states):
    force = loaded_node(solved, states)
    force *= -1


def add_one_percent(solved, states):
    i, surface = solved.slave
    states[i].force[surface.nodes] *= 1.01


def leave_inside(solved, states):
    state = states[0]
    _, surfaces = solved.slave, solved.stage.auditor.surfaces[0]
    inner = np.setdiff1d(np.flatnonzero(~state.held[:, 0]), np.concatenate(
        [s.nodes for s in surfaces]))  # fmt: skip
    state.force[inner[0], 0] += 1e-4 * np.abs(state.force).max()


def sink(solved, states):
    """Move the slave body down without forces, or up if it is below a tool."""
    i, _ = solved.slave
    up = 1 if solved.stage.tool is not None else -1
    states[i].u[:, solved.stage.up] += up * 0.1 * solved.stage.L


def lift(solved, states):
    """Keep the forces where bodies separate."""
    i, _ = solved.slave
    up = -1 if solved.stage.tool is not None else 1
    states[i].u[:, solved.stage.up] += up * 0.03 * solved.stage.L


def push_sideways(solved, states):
    force = loaded_node(solved, states)
    force[0] += 0.5 * np.abs(force).max()


def reverse_friction(solved, states):
    for surface, end in zip(solved.stage.auditor.surfaces[0], ends(solved), strict=True):
        states[end[0]].force[surface.nodes, 0] *= -1


def halve_friction(solved, states):
    for surface, end in zip(solved.stage.auditor.surfaces[0], ends(solved), strict=True):
        states[end[0]].force[surface.nodes, 0] *= 0.5


def ends(solved):
    joint = solved.stage.joint
    return [joint.slave] if solved.stage.tool is not None else [joint.slave, joint.master]


def not_a_number(solved, states):
    states[0].u[0, 0] = np.nan


def tilt_forces(solved, states):
    """Tilt the forces on the opponent of a plane by a thousandth."""
    i, surface = solved.slave
    force = states[i].force
    force[surface.nodes, 0] += 1e-3 * force[surface.nodes, 1]


def move_couples(solved, states):
    """Permute the nodal forces of one body: their sum is kept, their moment is not."""
    i, surface = solved.slave
    order = surface.nodes[np.argsort(states[i].x[surface.nodes, 0])]
    states[i].force[order] = states[i].force[order[::-1]]


# --- Faults planted in the library's results, by field


def scale(field, factor=1.01):
    """Multiply a result at all nodes by a factor."""

    def plant(reading):
        return dataclasses.replace(reading, **{field: factor * getattr(reading, field)})

    plant.__name__ = f"scale {field}"
    return plant


def scale_field(field):
    def plant(reading):
        return dataclasses.replace(
            reading, fields=reading.fields | {field: 1.01 * reading.fields[field]}
        )

    plant.__name__ = f"scale {field} in the fields"
    return plant


def open_all(reading):
    status = np.minimum(reading.fields["status"], 1.0)
    return dataclasses.replace(reading, fields=reading.fields | {"status": status})


def without_friction(reading):
    """Remove friction from the results at nodes that conditions move."""
    return dataclasses.replace(reading, tangential=0 * reading.tangential)


#: Planted faults, the kinds of scenes with them, and the audit that must detect them.
PLANTED = [
    (flip, ("node by node", "overlay", "loaded", "sphere", "large"), "tension"),
    (add_one_percent, ("node by node", "overlay", "3D, degree 2", "tied", "large"), "action"),
    (add_one_percent, tuple(KINDS), "reported"),
    (add_one_percent, tuple(KINDS), "balance"),
    (leave_inside, tuple(KINDS), "equilibrium"),
    (sink, ("node by node", "overlay", "3D, degree 2", "loaded", "sphere", "large"), "penetration"),
    (lift, ("node by node", "overlay", "3D, degree 2", "loaded", "large"), "complementarity"),
    (lift, ("tied",), "tie"),
    (push_sideways, ("loaded",), "normal"),
    (push_sideways, ("node by node", "overlay", "large", "sphere"), "cone"),
    (reverse_friction, ("node by node", "overlay", "3D, degree 2", "large"), "direction"),
    (halve_friction, ("node by node", "overlay", "3D, degree 2", "large"), "stick"),
    (tilt_forces, ("plane",), "normal"),
    (move_couples, ("tied across a gap",), "action"),
    (not_a_number, tuple(KINDS), "finite"),
]

#: Faults planted in results, the kinds of scenes with them, and the audit that must detect them.
READINGS = [
    (scale("traction"), tuple(KINDS), "traction"),
    (scale("tangential"), ("node by node", "3D, degree 2", "sphere"), "traction"),
    (scale("pressure"), tuple(KINDS), "pressure"),
    (scale("moment"), ("node by node", "overlay", "3D, degree 2", "tied", "sphere"), "moment"),
    (scale_field("pressure"), tuple(KINDS), "fields"),
    (scale_field("traction"), tuple(KINDS), "fields"),
    (open_all, ("node by node", "overlay", "3D, degree 2", "large"), "fields"),
    (without_friction, ("dragged",), "held"),
]


@pytest.mark.parametrize("kind", KINDS)
def test_planted_faults(kind):
    solved = Solved(KINDS[kind])
    assert solved.right == []
    for plant, kinds, check in PLANTED:
        if kind in kinds:
            assert check in solved.names(plant), plant.__name__
    auditor = solved.stage.auditor
    read = auditor.read_contact
    for plant, kinds, check in READINGS:
        if kind in kinds:
            auditor.read_contact = lambda number, p=plant: [p(r) for r in read(number)]
            assert check in solved.names(lambda *nothing: None), plant.__name__
    auditor.read_contact = read
    assert auditor.audit_update() == []
    calls = itertools.count()
    auditor.read_contact = lambda number: [
        scale("force", 1 + 1e-6 * next(calls))(r) for r in read(number)
    ]
    assert {fault.check for fault in auditor.audit_update()} == {"update"}


@pytest.mark.parametrize("kind", ("node by node", "3D, degree 2", "large"))
def test_one_displacement(kind):
    """A change of an unknown by a millionth of the scene's length is detected in the residual."""
    solved = Solved(KINDS[kind])
    stage = solved.stage
    body = stage.bodies[0]
    target = np.argmin(np.linalg.norm(solved.states[0].x - stage.L * np.array(
        [0.5, 0.5 * stage.up - 0.5, -0.5 * (stage.up - 1)]), axis=1))  # fmt: skip
    index_map = body.V.dofmap.index_map
    if target in range(*index_map.local_range):
        body.u.x.array[(target - index_map.local_range[0]) * stage.scene.gdim] += 1e-6 * stage.L
    stage.auditor.before = list(solved.before)
    checks = {fault.check for fault in stage.auditor.audit()}
    assert checks & {"equilibrium", "reported", "action"}


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
@pytest.mark.parametrize("degree", (1, 2))
def test_surface(cell, degree):
    """Area, normals and functions of degree 1 of the face of a box."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    msh = box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
    V = fem.functionspace(msh, ("Lagrange", degree, (gdim,)))
    x = np.concatenate(
        WORLD.allgather(V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local])
    )
    surface = read_surface(V, plane(msh, gdim - 1, 1.0), x)
    assert len(surface.nodes) == (3 * degree + 1) ** (gdim - 1)
    assert len(surface.vertices) == 4 ** (gdim - 1)
    np.testing.assert_allclose(surface.hat.sum(axis=0), 1.0)
    np.testing.assert_allclose(surface.hat.T @ x[surface.vertices], x[surface.nodes], atol=1e-14)
    corners = x[surface.pieces]
    t = corners[:, 1:] - corners[:, :1]
    if gdim == 2:
        normals = np.stack([t[:, 0, 1], -t[:, 0, 0], 0 * t[:, 0, 0]], axis=1)
    else:
        normals = np.cross(t[:, 0], t[:, 1]) / 2
    total = (normals * surface.sign[:, None]).sum(axis=0)
    np.testing.assert_allclose(total, np.eye(3)[gdim - 1], atol=1e-14)


def test_nodes_of_degree_two_alone():
    """A node elsewhere on a facet raises an error."""
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.3, 0, 0], [0, 1.0, 0]])
    with pytest.raises(ValueError, match="where one of degree 2 would be"):
        assemble_surface(np.array([[0, 1, 2]]), np.array([3]), 2, 2, x)
