"""Scenes of the rubber demo: bodies, tools, and motion of the tools."""

import numpy as np

import qsdolfinx as qs

from rubber_bodies import MU, RADIUS, o_ring, sheet

HALF_WIDTH, SQUEEZE = 1.5, 0.25  # half width of the groove, squeeze over the ring's height
ROLLER, DEPTH, DRAG, PRESSING = 30.0, 3.0, 0.015 * MU, 5  # PRESSING in steps


class Ring:
    """The O-ring, its groove and its lid.

    Args:
        comm: Communicator.
        p: Parameters.
    """

    def __init__(self, comm, p):
        self.p, self.body = p, o_ring(comm, p.facet)
        faces = (0, RADIUS), (0, -RADIUS), (-HALF_WIDTH, 0), (HALF_WIDTH, 0)
        self.tools = [qs.RigidSurface.plane(comm, x, -np.array(x, dtype=float)) for x in faces]
        self.lid, self.opposite = self.tools[:2]
        self.pressing = max(1, p.steps // 2)
        self.end = float(p.steps) if p.distance else float(self.pressing)

    def drive(self, t, dt):
        """Move the lid down, and then to the right."""
        down = min(t, self.pressing) - min(t - dt, self.pressing)
        right = self.p.distance * (dt - down) / max(1, self.p.steps - self.pressing)
        self.lid.displacement = [right, -2 * RADIUS * SQUEEZE * down / self.pressing]

    def moved(self):
        """Return the displacement of the ring. Collective."""
        return self.body.moved()

    def lines(self):
        """Return the groove and the lid as lines for the picture."""
        x, y = HALF_WIDTH, self.lid.center[1]
        groove = [(-x, y - 0.02), (-x, -RADIUS), (x, -RADIUS), (x, y - 0.02)]
        return [np.array(groove), np.array([(-2.0, y), (2.0, y)])]


class Roller:
    """The sheet and the roller.

    Args:
        comm: Communicator.
        p: Parameters.
    """

    def __init__(self, comm, p):
        self.p, self.body = p, sheet(comm, p.facet)
        self.lid = qs.RigidSurface.cylinder(comm, [0.0, ROLLER], None, ROLLER)
        self.tools, self.pressing = [self.lid], PRESSING
        self.end = PRESSING + (float(p.steps) if p.distance else 0.0)

    def drive(self, t, dt):
        """Press the roller, and then turn it; it is force-controlled along the sheet."""
        if t <= PRESSING:
            self.lid.displacement = [0.0, -DEPTH * dt / PRESSING]
            return
        angle = 2 * np.pi * self.p.distance * dt / self.p.steps
        self.lid.rotation = angle
        self.lid.displacement = [-0.93 * ROLLER * angle, 0.0]  # first guess
        self.lid.drive(DRAG, [-1.0, 0.0])

    def moved(self):
        """Return the displacement of the roller."""
        return self.lid.center[0]

    def lines(self):
        """Return the roller and one of its spokes as lines for the picture."""
        angle = np.linspace(-np.pi / 2, 3 * np.pi / 2, 200)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        R = self.lid.position[:, :2]
        rim = self.lid.center + ROLLER * (R @ circle).T
        return [rim, np.array([self.lid.center, rim[0]])]
