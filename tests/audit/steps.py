"""Audit the steps of a history with DOLFINx and NumPy alone: see ``auditor``.

The configuration of contact detection in a step is documented. Here it is computed from the
unknowns at the end of the solves of the step: for the first contact detection, the positions of the
bodies if they continued to move as before; for a second contact detection, the positions from the
previous solve. Normals and partners belong to this configuration; the motion since then is small
sliding. Slip is the relative motion of the bodies from the end of the last step to the end of this
step. The jump of a tie is the relative motion since the tie was made.
"""

import dataclasses

from mpi4py import MPI

import numpy as np
from audit import friction, readings, ties
from audit.auditor import (
    CLOSE,
    LEAST,
    NAMES,
    PART,
    ROUNDING,
    AuditedBody,
    Fault,
    Joint,
    body_balance,
    compare,
    complementarity,
    directions,
    equilibrium,
    pair_balance,
    penetration,
    reported_force,
    tied_gaps,
)
from audit.distance import Meshed
from audit.rigid import FacetTool, Motion, displaced
from audit.sides import places, read_side
from audit.state import BodyState, SurfaceState, read_surface


@dataclasses.dataclass
class Places:
    """Positions of the nodes of a body at some times, each of shape (nodes, 3).

    Attributes:
        first: At the start of the history.
        before: At the end of the last step.
        paired: At contact detection.
        solved: On the mesh on which the residual was assembled.
        now: At the end of this step.
        rate: Displacement per time in this step.
        force: Forces of contact and conditions.
        rest: Residual of other unknowns.
        held: Components with conditions.
    """

    first: np.ndarray
    before: np.ndarray
    paired: np.ndarray
    solved: np.ndarray
    now: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    rest: np.ndarray
    held: np.ndarray

    def since(self, start):
        """Return the state of a body with another time as its undeformed state."""
        return BodyState(start, self.now - start, self.force, self.held)


class StepAuditor:
    """Audits a history step by step; call :meth:`audit` after each step.

    Args:
        play: The history, before its first step.
    """

    def __init__(self, play):
        self.play, self.history, self.length = play, play.history, play.L
        self.local = [a.start for a in play.actors]  # at the end of the last step
        self.first = [a.nodes.gather(a.start) for a in play.actors]
        self.held = [a.nodes.held(a.bcs) for a in play.actors]
        self.rates = [np.zeros_like(a.start) for a in play.actors]
        self.surfaces: list[SurfaceState] = [
            read_surface(a.nodes.V, a.face, x) for a, x in zip(play.actors, self.first, strict=True)
        ]
        self.tool_before = Motion.none()
        self.volumes = [volumes(a) for a in play.actors]
        self.t, self.num_steps = 0.0, 0
        self.friction: tuple[np.ndarray, np.ndarray] | None = None
        self.joint = self.make_joint()
        self.about = 0.7 * self.length * np.array([0.4, -1.0, play.up - 1])
        stiffest = self.history.E * (1.0 if self.history.has_tool else max(1.0, self.history.ratio))
        self.force = stiffest * self.history.depth * self.length**play.up

    def make_joint(self):
        history, play = self.history, self.play
        return Joint(
            slave=(0, None),
            master=play.own_tool if play.own_tool is not None else (1, None),
            tied=history.tied,
            mu=history.mu if history.friction == "coulomb" else 0.0,
            shear=history.mu * play.softest if history.friction == "tresca" else 0.0,
            viscous=history.friction == "norton",
            formulation=history.options["formulation"],
            nodal=history.options["quadrature"] == "nodal",
            at_points=play.contact.settings.constraints == "points",
            follows=history.options.get("sliding") == "finite" and not history.tied,
            reported=lambda: play.contact.force("slave"),
            dissipated=lambda: play.contact.step_dissipation(),
            contact=play.contact,
        )

    # --- Reading

    def read(self):
        """Read the positions of the bodies in the last step, and of the tool; collective."""
        play, dt = self.play, self.play.stepper.last_dt
        contact = play.contact
        self.joint.penalty = None if contact.model.augmented else contact.penalty
        self.joint.allowed_gap = (
            10 * contact.settings.gap_tolerance * self.length if contact.model.augmented else 0.0
        )
        out, local = [], []
        for i, actor in enumerate(play.actors):
            x, solution = self.local[i], play.solutions[-1][i]
            values = actor.nodes.values(solution)
            now = x + dt * values if actor.flows else actor.start + values
            paired = self.paired(i, dt)
            gather = actor.nodes.gather
            solved, force, rest = play.assembled[i]
            places_of = Places(
                self.first[i], gather(x), gather(paired), solved, gather(now),
                gather((now - x) / dt), force, rest, self.held[i],
            )  # fmt: skip
            out.append(places_of)
            local.append(now)
        tool = None
        if play.tool is not None:
            tool = play.tool_paired[-1], Motion.read(play.tool.position)
        return out, local, tool

    @property
    def base(self):
        """Number of solves in a step with one contact detection."""
        flows = any(self.history.flows) and self.play.stepper.theta > 0
        return 2 if self.num_steps == 0 and flows else 1

    def paired(self, i, dt):
        """Return body i at the last contact detection; non-vertex nodes are interpolated."""
        play, actor = self.play, self.play.actors[i]
        x, solutions = self.local[i], self.play.solutions
        if len(solutions) == 1:
            theta = play.stepper.theta if actor.flows else 1.0
            out = x + theta * dt * self.rates[i]
        else:
            values = actor.nodes.values(solutions[-2][i])
            if not actor.flows:
                out = actor.start + values
            else:
                out = x + dt * values * (play.stepper.theta or 1.0)
        return actor.nodes.straight(out)

    def volumes_now(self):
        return [volumes(a) for a in self.play.actors]

    # --- Auditing

    def audit(self):
        """Return the faults of the last step, the same on all ranks. Collective."""
        bodies, local, tool = self.read()
        faults = self.check(bodies, tool)
        self.go_on(bodies, local, tool)
        return faults

    def check(self, bodies, tool):
        """Return the faults of a step with this end."""
        if not all(np.all(np.isfinite(b.now)) and np.all(np.isfinite(b.force)) for b in bodies):
            return [Fault("finite", np.inf, "the solution is not finite")]
        tolerance = self.force_tolerance(bodies)
        faults = self.kinematics(bodies)
        if tool is not None:
            faults += self.tool_motion(tool)
        for i, body in enumerate(bodies):
            faults += self.equilibrium(i, body, tolerance)
        sides = self.sides(bodies, tool)
        faults += self.contact(bodies, tool, sides, tolerance)
        faults += self.driven(sides, tolerance)
        return faults + self.readings(bodies, tool, sides, tolerance)

    def go_on(self, bodies, local, tool):
        """Make this end of a step the start of the next step."""
        dt = self.play.stepper.last_dt
        for i, actor in enumerate(self.play.actors):
            self.rates[i] = (local[i] - self.local[i]) / dt
            if actor.flows:  # bubbles are not positions
                self.rates[i] = actor.nodes.values(self.play.solutions[-1][i])
        if self.joint.rubs:
            side = self.sides(bodies, tool)[0]
            self.friction = side.tangential / side.area[:, None], -side.pull
        if tool is not None:
            self.tool_before = tool[1]
        self.local, self.volumes = local, self.volumes_now()
        self.t, self.num_steps = self.play.stepper.t, self.num_steps + 1

    def force_tolerance(self, bodies):
        """Return the largest force that counts as zero."""
        total = sum(
            np.sum(b.force[b.held | self.on_contact(i)[:, None]] ** 2) for i, b in enumerate(bodies)
        )
        return PART * np.sqrt(total) + LEAST * self.force

    def on_contact(self, i):
        out = np.zeros(len(self.first[i]), dtype=bool)
        out[self.surfaces[i].nodes] = True
        return out

    def equilibrium(self, i, body, tolerance):
        """Check the equilibrium of one body, on the mesh of its solve."""
        actor = self.play.actors[i]
        large = actor.material == "neo"
        state = BodyState(body.now if large else body.solved, 0 * body.now, body.force, body.held)
        on_contact = self.on_contact(i)
        faults = equilibrium(i, state, on_contact, tolerance)
        audited = AuditedBody(None, None, [])
        faults += body_balance(i, audited, state, on_contact, tolerance, self.length)
        if len(body.rest):
            speed = self.history.depth * self.length**self.history.gdim
            slack = 1e-6 * speed + 1e-6 * np.abs(body.rate).max() * self.length**self.play.up
            faults += compare("volume", np.abs(body.rest), slack, f"body {i}, divergence")
        return faults

    # --- Motion

    def kinematics(self, bodies):
        """Check time, meshes and conditions."""
        stepper, faults = self.play.stepper, []
        dt, close = stepper.last_dt, CLOSE * self.length
        faults += compare("time", abs(stepper.t - self.t - dt), 1e-9, "t is not the sum of steps")
        for i, (actor, body) in enumerate(zip(self.play.actors, bodies, strict=True)):
            vertices = self.vertices(i)
            mesh = actor.nodes.gather(actor.nodes.places())
            expected, solved = body.first, body.first
            if actor.flows:
                expected = body.now
                known = self.rates[i]
                if len(self.play.solutions) >= 2 and self.base == 2:
                    known = actor.nodes.values(self.play.solutions[0][i])
                solved = actor.nodes.gather(self.local[i] + stepper.theta * dt * known)
            for what, x, y in (("mesh", mesh, expected), ("mesh solved on", body.solved, solved)):
                error = np.abs(x - y)[vertices]
                faults += compare(what, error, close, f"body {i} is elsewhere")
            told = self.play.motion(i, stepper.t)(self.first[i])
            if actor.flows:
                told = told + body.before - self.play.motion(i, self.t)(self.first[i])
            on_end = np.all(body.held, axis=1) & vertices
            faults += compare(
                "conditions", np.abs(body.now - told)[on_end], close, f"end of body {i}"
            )
            if actor.material == "mini":
                faults += self.volume(i, body)
        return faults

    def vertices(self, i):
        """Return which nodes of body i are not bubbles."""
        actor = self.play.actors[i]
        if actor.material != "mini":
            return np.ones(len(self.first[i]), dtype=bool)
        V = actor.nodes.V
        tdim = V.mesh.topology.dim
        inner = V.dofmap.dof_layout.entity_dofs(tdim, 0)
        flags = np.ones((len(actor.start), 1))
        flags[V.dofmap.list[:, inner]] = 0.0
        return actor.nodes.gather(flags)[:, 0] > 0

    def volume(self, i, body):
        """Check the volume of an incompressible body: div v is zero in the mean in the solve."""
        before, now = self.volumes[i], self.volumes_now()[i]
        actor, play = self.play.actors[i], self.play
        dt, gdim = play.stepper.last_dt, self.history.gdim
        end = self.local[i] + dt * actor.nodes.values(play.solutions[-1][i])
        strain = largest_gradient(actor, self.local[i], end - self.local[i])
        middle = actor.nodes.straight(0.5 * (self.local[i] + end))
        known = self.rates[i]
        if len(play.solutions) >= 2 and self.base == 2:
            known = actor.nodes.values(play.solutions[0][i])
        solved = self.local[i] + play.stepper.theta * dt * known
        off = largest_gradient(actor, self.local[i], solved - middle)
        bound = 2 * gdim**2 * (strain * off + strain**gdim) + 1e-7
        return compare("volume", abs(now / before - 1), bound, f"body {i}, change")

    def tool_motion(self, tool):
        """Check that a tool is where its motion says, except for the displacement along a force."""
        play = self.play
        told = play.motion(1, play.stepper.t)
        error = np.abs(tool[1].R - told.R).max()
        faults = compare("tool", error, ROUNDING, "rotation")
        off = tool[1](play.center) - told(play.center)
        if self.history.driven:
            off[play.up] = 0.0
        return faults + compare("tool", np.abs(off), CLOSE * self.length, "centre")

    def driven(self, sides, tolerance):
        """Check that the contact forces equal the force on a force-controlled tool."""
        if not self.history.driven:
            return []
        force = self.play.force(self.play.stepper.t)
        own = -sides[0].nodal_force.sum(axis=0)[self.play.up]
        slack = tolerance * np.sqrt(len(sides[0].nodal_x))
        return compare("driven", abs(own - force), slack, "force on the tool")

    # --- Readings

    def ends(self):
        """Return the names of the meshed sides and their bodies, slave first."""
        if self.history.has_tool:
            return [("slave", 0)]
        return list(
            zip(("slave", "master"), (0, 1) if self.history.swapped else (1, 0), strict=True)
        )

    def read_contact(self):
        """Read the library's results on the meshed sides, slave first. Collective."""
        actors, surfaces = self.play.actors, self.surfaces
        return [
            readings.read(
                self.play.contact, name,
                readings.Reader(actors[i].nodes.V, surfaces[i]), self.about,
            )
            for name, i in self.ends()
        ]  # fmt: skip

    def readings(self, bodies, tool, sides, tolerance):
        """Return the faults of the library's results on the contact. Collective.

        The points of action of the forces on a tool move with its centre.
        """
        out, moved = [], np.zeros(3)
        if tool is not None:
            center = self.play.center
            moved = tool[1](center) - tool[0](center)
        for (name, i), side, reading in zip(self.ends(), sides, self.read_contact(), strict=False):
            body, flows = bodies[i], self.play.actors[i].flows
            area_x = body.solved if flows else body.now
            moment_x = body.now if self.joint.finite else body.paired + moved
            expected = readings.Expected(side, area_x, body.now, moment_x, self.about)
            alone = self.joint.formulation != "double-pass"
            found_all = readings.faults(name, reading, expected, tolerance, self.joint.rubs, alone)
            for found in found_all:
                out += compare(*found)
        return out

    def audit_update(self):
        """Return results that change when contact is updated without a solve. Collective."""
        before, out = self.read_contact(), []
        self.play.contact.update()
        for pair in zip(NAMES, before, self.read_contact(), strict=False):
            for found in readings.changed(*pair):
                out += compare(*found)
        return out

    # --- Contact

    def meshed(self, i, body, start):
        return Meshed(body.since(start), self.surfaces[i])

    def opponents(self, bodies, tool, start):
        """Return the meshed sides and their opponents, slave first.

        Args:
            bodies: Positions of the bodies.
            tool: Position of the tool at zero displacements, and the present position.
            start: Name of the configuration with zero displacements.
        """
        own = [self.meshed(i, b, getattr(b, start)) for i, b in enumerate(bodies)]
        if tool is not None:
            posed = self.play.own_tool.at(*tool)
            return [(own[0], posed)] + [(posed, own[0])] * isinstance(posed, FacetTool)
        if not self.history.swapped:
            own.reverse()
        return [(own[0], own[1]), (own[1], own[0])]

    def sides(self, bodies, tool, start="paired"):
        """Return the sides of the contact."""
        if self.joint.follows and start == "paired":
            start, tool = "now", None if tool is None else (tool[1], tool[1])
        pairs = self.opponents(bodies, tool, start)
        alone = self.joint.node_by_node and not isinstance(pairs[0][1], Meshed)
        return [read_side(*pair, alone) for pair in pairs]

    def contact(self, bodies, tool, sides, tolerance):
        joint, length = self.joint, self.length
        forces = sides if tool is None else sides[:1]
        faults = reported_force(joint, sides, tolerance)
        if len(forces) == 2:
            arm = self.arm(bodies) if joint.tied else None
            # Forces of ties act on the deformed surfaces or, in small sliding, where they were
            # paired.
            there = self.sides(bodies, None, "now") if joint.tied and joint.finite else sides
            faults += pair_balance(joint, there, tolerance, length, arm)
        reach = 2 * sum(side.size for side in sides)
        if joint.tied:
            return faults + self.tie(bodies, tool, reach)
        for name, side in zip(("slave", "master"), sides, strict=False):
            if name == "slave" or len(forces) == 2:
                faults += directions(name, joint, side, tolerance)
                faults += complementarity(name, joint, sides, side, tolerance, reach, length)
            faults += penetration(name, joint, sides, side, reach, length)
        if joint.rubs and not joint.follows:  # slip is not counted from contact detection
            faults += self.slip(bodies, tool, sides, tolerance)
        return faults

    def tie(self, bodies, tool, reach):
        """Check the jumps since the tie was made."""
        since = None if tool is None else (Motion.none(), tool[1])
        sides = self.sides(bodies, since, "first")
        there = [dataclasses.replace(b, now=b.paired) for b in bodies]
        paired = self.sides(there, since, "first")
        return tied_gaps(self.joint, sides, reach, self.length, paired)

    def arm(self, bodies):
        """Return the jump of a tie between bodies in the configuration in which its forces act."""
        there = [b if self.joint.finite else dataclasses.replace(b, now=b.paired) for b in bodies]
        return ties.arm(self.sides(there, None, "first"))

    def slip(self, bodies, tool, sides, tolerance):
        """Check friction against the slip since the last step."""
        side = sides[0]
        i = 0 if tool is not None or self.history.swapped else 1
        n = side.num_vertices
        body = bodies[i]
        u = places(side.own.surface, body.before - body.paired)
        if tool is None:
            master = bodies[1 - i]
            was = displaced(side.opponent, None, master.before - master.paired)
        else:
            was = displaced(side.opponent, self.tool_before)
        jump = (u - was.displacement(side.rest))[:n]
        if self.friction is None:
            self.friction = np.zeros((n, 3)), np.zeros(n)
        stress, pushed = self.friction
        before = friction.Memory(jump, stress * side.area[:, None], pushed)
        now = friction.read_memory(sides)
        angle = self.turned(side, body) + (0 if tool is None else np.linalg.norm(
            tool[1].since(self.tool_before).vector()))  # fmt: skip
        found = friction.faults(self.joint, sides, before, now, tolerance, angle)
        if not self.history.options.get("formulation") == "double-pass":
            means = any(self.history.flows)
            found += friction.energy(self.joint, sides, before, now, tolerance, means)
        return [Fault(*fault) for fault in found]

    def turned(self, side, body):
        """Return the largest rotation angle of a part of the surface in the step."""
        pieces = side.own.surface.pieces
        normals = [side.own.normals(x[pieces]) for x in (body.before, body.now)]
        return np.linalg.norm(normals[1] - normals[0], axis=1).max()


def volumes(actor):
    """Return the volume of the present mesh of a body, from its cells' vertices. Collective."""
    local = cell_gradients(actor, actor.nodes.places(), None)[0].sum()
    return actor.nodes.comm.allreduce(float(local), op=MPI.SUM)


def cell_gradients(actor, x, values):
    """Return volumes of this rank's simplices, and gradients of values at their vertices."""
    nodes, gdim = actor.nodes, actor.nodes.gdim
    count = nodes.V.mesh.topology.index_map(gdim).size_local
    corners = nodes.V.dofmap.list[:count, nodes.corners]
    if corners.shape[1] != gdim + 1:
        return np.zeros(count), None
    edges = x[corners][:, 1:, :gdim] - x[corners][:, :1, :gdim]
    volume = np.abs(np.linalg.det(edges)) / (2 if gdim == 2 else 6)
    if values is None:
        return volume, None
    change = values[corners][:, 1:, :gdim] - values[corners][:, :1, :gdim]
    return volume, np.linalg.solve(edges, change)


def largest_gradient(actor, x, values):
    """Return the largest norm of the gradient of a field in a cell. Collective."""
    gradients = cell_gradients(actor, x, values)[1]
    local = np.linalg.norm(gradients, axis=(1, 2)).max(initial=0.0)
    return actor.nodes.comm.allreduce(float(local), op=MPI.MAX)
