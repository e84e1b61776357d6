"""Test that the auditor of time steps finds faults planted in a step, and none without them."""

import dataclasses

import numpy as np
import pytest
from audit.histories import Waypoint, random_history
from audit.play import Play
from audit.rigid import FacetTool, Motion
from audit.run import Historian
from audit.steps import StepAuditor

PLAIN = dataclasses.replace(
    random_history(0),
    gdim=2,
    cells=("quadrilateral", "triangle"),
    n=((5, 3), (4, 3)),
    degree=1,
    materials=("elastic", "elastic"),
    driven=False,
    swapped=False,
    curvature=0.0,
    wave=0.0,
    gap=0.0,
    depth=0.01,
    slide=0.05,
    turn=0.02,
    carry=0.0,
    ratio=1.0,
    nu=0.3,
    m=0.6,
    path=(Waypoint(1.0), Waypoint(1.0, 1.0), Waypoint(1.0, 2.0)),
    tied=False,
    friction="coulomb",
    mu=0.2,
    stiff=100.0,
    options={"formulation": "master-slave", "quadrature": "nodal", "enforcement": "penalty"},
    stepping={},
    solver="direct",
    refused=0,
    restarted=0,
    E=3.0,
    L=2.0,
)
OVERLAY = {"formulation": "quasi-symmetric", "quadrature": "overlay", "enforcement": "penalty"}
AUGMENTED = OVERLAY | {"enforcement": "augmented-lagrangian"}
SOLID = {"gdim": 3, "cells": ("hexahedron", "tetrahedron"), "n": ((3, 3, 2), (2, 2, 2))}
TURNED = (Waypoint(1.0), Waypoint(1.0, 0.0, 1.0), Waypoint(1.0, 1.0, 1.0))
CARRIED = (Waypoint(1.0), Waypoint(1.0, 0.0, 0.0, 1.0), Waypoint(1.0, 1.0, 0.0, 2.0))
KINDS = {
    "blocks": PLAIN,
    "overlay, degree 2": dataclasses.replace(PLAIN, degree=2, options=OVERLAY),
    "plane": dataclasses.replace(PLAIN, materials=("neo", "plane"), path=TURNED),
    "driven": dataclasses.replace(
        PLAIN,
        materials=("elastic", "sphere"),
        curvature=0.3,
        driven=True,
        options=AUGMENTED | {"constraints": "nodes"},
    ),
    "facets": dataclasses.replace(
        PLAIN,
        materials=("viscous", "facets"),
        friction="tresca",
        mu=0.001,
        options=OVERLAY,
        **SOLID,
    ),
    "flow": dataclasses.replace(
        PLAIN,
        materials=("mini", "neo"),
        cells=("triangle", "quadrilateral"),
        friction="norton",
        mu=0.002,
        options=OVERLAY,
    ),
    "sticking": dataclasses.replace(PLAIN, slide=0.001, mu=0.6, materials=("elastic", "plane")),
    "tied": dataclasses.replace(
        PLAIN,
        materials=("neo", "neo"),
        path=CARRIED,
        carry=0.1,
        tied=True,
        friction="",
        mu=0.0,
        options=OVERLAY,
    ),
    "flat facets": dataclasses.replace(
        PLAIN, materials=("elastic", "facets"), wave=0.01, friction="", mu=0.0, options=OVERLAY
    ),
    "tied across a gap": dataclasses.replace(
        PLAIN,
        materials=("neo", "neo"),
        path=CARRIED,
        carry=0.1,
        gap=0.2,
        tied=True,
        friction="",
        mu=0.0,
        options=OVERLAY,
    ),
    "tied to a plane": dataclasses.replace(
        PLAIN, materials=("viscous", "plane"), path=TURNED, tied=True, friction="", mu=0.0
    ),
}


class Made:
    """A history at the end of its last step; positions are read once and may be modified."""

    def __init__(self, history):
        self.play = Play(history)
        self.auditor = StepAuditor(self.play)
        self.right: list = []
        end = len(history.path)
        while self.play.stepper.t < end - 1e-9:
            self.play.stepper.step(end)
            self.bodies, local, self.tool = self.auditor.read()
            self.right += self.auditor.check(self.bodies, self.tool)
            if self.play.stepper.t < end - 1e-9:
                self.auditor.go_on(self.bodies, local, self.tool)

    @property
    def slave(self):
        """Return the index of the slave body."""
        return 0 if self.tool is not None or self.play.history.swapped else 1

    def names(self, plant):
        """Return the audits that detect a fault in copies of the positions, or in the auditor."""
        auditor, kept = self.auditor, dict(vars(self.auditor))
        bodies = [
            dataclasses.replace(b, **{k: v.copy() for k, v in vars(b).items()}) for b in self.bodies
        ]
        tool = plant(self, bodies) or self.tool
        try:
            return {fault.check for fault in auditor.check(bodies, tool)}
        finally:
            vars(auditor).pop("read_contact", None)
            vars(auditor).update(kept)


def surface_nodes(made):
    return made.auditor.surfaces[made.slave].nodes


def on_surfaces(made, bodies):
    """Yield the forces of all contact nodes."""
    for i, body in enumerate(bodies):
        yield body, made.auditor.surfaces[i].nodes


def flip(made, bodies):
    """Reverse the largest contact force, so that it pulls."""
    force, nodes = bodies[made.slave].force, surface_nodes(made)
    force[nodes[np.argmax(np.linalg.norm(force[nodes], axis=1))]] *= -1


def add_one_percent(made, bodies):
    bodies[made.slave].force[surface_nodes(made)] *= 1.01


def leave_inside(made, bodies):
    body = bodies[0]
    inner = np.flatnonzero(~body.held[:, 0] & ~made.auditor.on_contact(0))
    body.force[inner[0], 0] += 1e-4 * np.abs(body.force).max()


def sink(made, bodies):
    """Move the slave body deeper into the other body than forces explain."""
    play, body = made.play, bodies[made.slave]
    up = 1 if made.slave == 0 else -1
    body.now[:, play.up] += up * 0.05 * play.L


def lift(made, bodies):
    """Keep the forces where bodies separate."""
    play, body = made.play, bodies[made.slave]
    up = -1 if made.slave == 0 else 1
    body.now[:, play.up] += up * 0.03 * play.L


def push_sideways(made, bodies):
    force, nodes = bodies[made.slave].force, surface_nodes(made)
    largest = nodes[np.argmax(np.linalg.norm(force[nodes], axis=1))]
    force[largest, 0] += 0.5 * np.abs(force[largest]).max()


def reverse_friction(made, bodies):
    """Reverse friction on both sides; needs all nodes to be vertices."""
    for side in made.auditor.sides(bodies, made.tool):
        if not isinstance(side.own, FacetTool):
            side.body.force[side.own.surface.vertices] -= 2 * side.tangential


def halve_friction(made, bodies):
    for body, nodes in on_surfaces(made, bodies):
        body.force[nodes, 0] *= 0.5


def slip_back(made, bodies):
    """Make the bodies slide by a distance in the opposite direction in this step."""
    for body in bodies[1:] or bodies:
        way = 0.2 * made.play.L * (1 if made.slave or len(bodies) > 1 else -1)
        body.before[:, 0] += way


def not_a_number(made, bodies):
    bodies[0].now[0, 0] = np.nan


def move_a_node(made, bodies):
    """Move a node of the mesh away from its position by velocities, or of the reference."""
    node = np.argmax(made.auditor.vertices(0))
    bodies[0].now[node] += 1e-5 * made.play.L
    bodies[0].first[node] += 1e-5 * made.play.L


def solve_elsewhere(made, bodies):
    bodies[0].solved[np.argmax(made.auditor.vertices(0)), 0] += 1e-5 * made.play.L


def slip_at_the_end(made, bodies):
    """Move the held nodes away from their prescribed positions."""
    bodies[0].now[:, 0] += 1e-5 * made.play.L


def move_tool(made, bodies):
    return made.tool[0], Motion.about(np.zeros(3), np.zeros(3), 1e-5 * made.play.L).after(
        made.tool[1]
    )


def turn_tool(made, bodies):
    center = made.tool[1](made.play.center)
    return made.tool[0], Motion.about([0.0, 0.0, 1e-6], center).after(made.tool[1])


def lose_time(made, bodies):
    made.auditor.t = made.auditor.t - 1e-6


def forget_friction(made, bodies):
    """Set the friction at the start of the step to zero."""
    stress, pushed = made.auditor.friction
    made.auditor.friction = 0 * stress, pushed


def swell(made, bodies):
    made.auditor.volumes = [0.97 * v for v in made.auditor.volumes]


def diverge(made, bodies):
    bodies[0].rest[0] += 1e-4 * made.play.L**2 * np.abs(bodies[0].rate).max()


def creep(made, bodies):
    """Move ties by a hundredth of a facet without a force that explains it."""
    bodies[made.slave].now[:, 0] += 0.01 * made.play.L


def take_more(made, bodies):
    """Report three times the frictional energy of the forces."""
    taken = made.play.contact.step_dissipation()
    joint = made.auditor.joint
    made.auditor.joint = dataclasses.replace(joint, dissipated=lambda: 3 * taken)


def take_nothing(made, bodies):
    """Report almost no frictional energy."""
    joint = made.auditor.joint
    made.auditor.joint = dataclasses.replace(joint, dissipated=lambda: 0.0)


def tilt_forces(made, bodies):
    """Tilt the forces on a flat tool by a thousandth."""
    force, nodes = bodies[made.slave].force, surface_nodes(made)
    force[nodes, 0] += 1e-3 * force[nodes, 1]


def turn_without_gap(made, bodies):
    """Rotate the master's face about itself, under the tied slave."""
    i = 1 - made.slave
    now, nodes = bodies[i].now, made.auditor.surfaces[i].nodes
    turn = Motion.about([0.0, 0.0, 0.03], now[nodes].mean(axis=0))
    now[nodes] = turn(now[nodes])


def swap_forces(made, bodies):
    """Permute the nodal forces of a body: their sum is kept, their moment is not."""
    body = bodies[made.slave]
    order = surface_nodes(made)
    order = order[np.argsort(body.now[order, 0])]
    body.force[order] = body.force[order[::-1]]


def scale_reading(field, factor=1.01):
    """Multiply the library's results at all nodes by a factor."""

    def plant(made, bodies):
        read = type(made.auditor).read_contact

        def scaled():
            return [
                dataclasses.replace(r, **{field: factor * getattr(r, field)})
                for r in read(made.auditor)
            ]

        made.auditor.read_contact = scaled

    plant.__name__ = f"scale {field}"
    return plant


def forget_fields(made, bodies):
    """Return fields of another time."""
    read = type(made.auditor).read_contact
    made.auditor.read_contact = lambda: [
        dataclasses.replace(r, fields={k: 0 * f for k, f in r.fields.items()})
        for r in read(made.auditor)
    ]


ALL = tuple(KINDS)
TIED = ("tied", "tied across a gap", "tied to a plane")
OPEN = tuple(kind for kind in ALL if kind not in TIED)
TOOLS = ("plane", "driven", "facets", "flat facets", "sticking", "tied to a plane")
LIMITED = ("blocks", "plane", "driven")

#: Planted faults, the kinds of histories with them, and the audit that must detect them.
PLANTED = [
    (flip, ("blocks", "plane", "driven", "facets"), "tension"),
    (add_one_percent, ALL, "reported"),
    (add_one_percent, ALL, "balance"),
    (add_one_percent, ("blocks", "overlay, degree 2", "flow", "tied"), "action"),
    (add_one_percent, ("driven",), "driven"),
    (leave_inside, ALL, "equilibrium"),
    (sink, OPEN, "penetration"),
    (lift, ("blocks", "overlay, degree 2", "plane", "facets", "flow"), "complementarity"),
    (lift, TIED, "tie"),
    (creep, TIED, "tie"),
    (push_sideways, LIMITED, "cone"),
    (reverse_friction, ("blocks", "driven", "facets", "flow"), "direction"),
    (slip_back, ("blocks", "overlay, degree 2", "driven", "facets", "flow"), "direction"),
    (halve_friction, ("blocks", "overlay, degree 2"), "stick"),
    (forget_friction, ("sticking",), "stick"),
    (not_a_number, ALL, "finite"),
    (move_a_node, ALL, "mesh"),
    (solve_elsewhere, ALL, "mesh solved on"),
    (slip_at_the_end, ALL, "conditions"),
    (move_tool, TOOLS, "tool"),
    (turn_tool, TOOLS, "tool"),
    (lose_time, ALL, "time"),
    (take_more, ("blocks", "plane", "flow"), "energy"),
    (take_nothing, ("blocks",), "energy"),
    (tilt_forces, ("flat facets",), "normal"),
    (turn_without_gap, ("tied across a gap",), "tie"),
    (swap_forces, ("tied across a gap",), "action"),
    (scale_reading("traction"), ALL, "traction"),
    (scale_reading("pressure"), ALL, "pressure"),
    (scale_reading("moment"), ALL, "moment"),
    (forget_fields, ALL, "fields"),
    (swell, ("flow",), "volume"),
    (diverge, ("flow",), "volume"),
]


@pytest.mark.parametrize("kind", KINDS)
def test_planted_faults(kind):
    made = Made(KINDS[kind])
    assert made.right == []
    missed = [
        (plant.__name__, check)
        for plant, kinds, check in PLANTED
        if kind in kinds and check not in made.names(plant)
    ]
    assert missed == []


def test_a_restart_from_elsewhere():
    """A restarted history that starts with another velocity is detected."""
    history = dataclasses.replace(KINDS["tied to a plane"], restarted=1)
    for factor in (1.0, 1.5):
        historian = Historian(history)
        found = set()
        for faults in historian.steps():
            found |= {fault.check for fault in faults}
            original = historian.restart

            def restart(original=original, historian=historian, factor=factor):
                original()
                historian.plays[1].stepper.rates[0] *= factor

            historian.restart = restart
        assert found == ({"restart"} if factor > 1 else set())
        historian.destroy()
