"""Audit a solved contact problem with DOLFINx and NumPy alone, without the library's results.

Contact forces at nodes are the assembled residual of a body there; distances are measured between
the deformed surfaces, by brute force. Quantities that are not exactly zero in the method have
bounds, which are computed here, too:

- Normals and contact pairs belong to the undeformed bodies (small sliding): true gaps and the gaps
  of the method differ by about (slide + initial gap) × (angle by which facets have rotated, or
  differ).
- Gaps are zero in the mean over a node's facets, unless each node has its own pair (nodal
  master-slave contact): between nodes, surfaces that are not parallel penetrate each other by facet
  × angle.
- The penalty leaves a penetration of pressure / penalty.
"""

import dataclasses
import typing

import numpy as np
from audit import friction, readings, ties
from audit.distance import Meshed, Tool
from audit.sides import Side, read_side
from audit.state import BodyState, SurfaceState, read_body, read_surface

#: Forces that count as zero: as a fraction of all contact forces and reactions, and of the scene's.
PART, LEAST = 1e-6, 1e-8

#: Rounding level of forces and directions.
ROUNDING = 1e-9

#: Lengths that count as zero, as a fraction of the scene's length.
CLOSE = 1e-7

#: Sides of a contact.
NAMES = ("slave", "master")

#: Ratio of the multiplier to the pressure from nodal forces, where meshes do not match.
SPIKE = 4.0


class Fault(typing.NamedTuple):
    """A fault: which audit found it, the excess over its tolerance, and where or how."""

    check: str
    excess: float
    text: str

    def __str__(self):
        return f"{self.check}: {self.text} ({self.excess:.1e} of the tolerance)"


@dataclasses.dataclass
class AuditedBody:
    """A body as it is given to the problem.

    Attributes:
        F: UFL residual.
        u: Unknown.
        bcs: Dirichlet conditions.
        load: Sum of its loads, shape (3,).
        moment: Moment of the loads about the origin, shape (3,); None where it is not known.
        large: Whether moments balance about the deformed nodes instead of the undeformed nodes.
    """

    F: typing.Any
    u: typing.Any
    bcs: list
    load: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    moment: np.ndarray | None = dataclasses.field(default_factory=lambda: np.zeros(3))
    large: bool = False


@dataclasses.dataclass
class Joint:
    """A contact with the options it was asked for.

    Attributes:
        slave: Index of the body, and facets on this rank.
        master: The same for the master, or a rigid tool.
        penalty: Stress per length; None if an augmented Lagrangian closes the gaps.
        allowed_gap: Gap that an augmented Lagrangian may leave (length).
        tied: Whether the contact is a tie.
        mu: Coulomb's coefficient of friction.
        shear: Tresca's limit (stress).
        viscous: Whether friction has no limit.
        formulation: Name of the formulation.
        nodal: Whether gaps are taken at nodes.
        at_points: Whether pressure is defined at quadrature points, and friction at nodes: around
            the edge of contact friction then reaches a facet further, so that μ N limits the
            friction of nodes together.
        follows: Whether the contact geometry is updated: normals, gaps and moments are then those
            of the deformed bodies.
        reported: Function that returns the force on the slave that the library reports.
        dissipated: Function that returns the frictional energy of the step that the library
            reports.
        contact: The library's contact, whose results are audited; None for none.
    """

    slave: tuple
    master: tuple | Tool
    penalty: float | None = None
    allowed_gap: float = 0.0
    tied: bool = False
    mu: float = 0.0
    shear: float = 0.0
    viscous: bool = False
    formulation: str = "quasi-symmetric"
    nodal: bool = False
    at_points: bool = False
    follows: bool = False
    reported: typing.Callable | None = None
    dissipated: typing.Callable | None = None
    contact: typing.Any = None

    @property
    def finite(self):
        """Whether forces act at the deformed positions of the bodies, also of tied bodies."""
        return self.contact is not None and self.contact.sliding == "finite"

    @property
    def rubs(self):
        """Whether there is friction."""
        return self.mu > 0 or self.shear > 0 or self.viscous

    def friction_limit(self, area, pushed):
        """Return the force at which vertices slip; infinite for friction without a limit."""
        return self.mu * np.maximum(pushed, 0.0) + self.shear * area

    @property
    def node_by_node(self):
        """Whether each slave node closes its own gap, independently of its neighbours."""
        one_sided = self.formulation == "master-slave"
        return self.nodal and (one_sided or (isinstance(self.master, Tool)))


class Auditor:
    """Audits a scene after each of its solves.

    Args:
        bodies: Bodies of the problem.
        joints: Contacts of the problem.
        length: Length of the scene.
        force: Force scale of the scene: modulus × strain × area.
    """

    def __init__(self, bodies, joints, length, force):
        self.bodies, self.joints, self.length, self.force = bodies, joints, length, force
        x = [read_body(b.F, b.u, b.bcs).x for b in bodies]
        self.surfaces: list[list[SurfaceState]] = []
        for joint in joints:
            ends = [end for end in (joint.slave, joint.master) if not isinstance(end, Tool)]
            self.surfaces.append(
                [read_surface(bodies[i].u.function_space, f, x[i]) for i, f in ends]
            )
        self.before: list[friction.Memory | None] = [None for _ in joints]
        self.about = (
            0.7 * length * np.array([0.4, -1.0, bodies[0].u.function_space.mesh.geometry.dim - 2])
        )

    def read(self):
        """Return the states of all bodies. Collective."""
        return [read_body(b.F, b.u, b.bcs) for b in self.bodies]

    def audit(self):
        """Return the faults of the state after a solve, the same on all ranks. Collective."""
        states = self.read()
        tolerance = self.force_tolerance(states)
        faults = self.finite(states)
        if faults:
            return faults
        for i, (body, state) in enumerate(zip(self.bodies, states, strict=True)):
            on_contact = self.contact_nodes(i, state)
            faults += equilibrium(i, state, on_contact, tolerance)
            faults += body_balance(i, body, state, on_contact, tolerance, self.length)
        for number, joint in enumerate(self.joints):
            sides = self.sides(number, states)
            faults += joint_faults(joint, sides, tolerance, self.length)
            faults += self.readings(number, sides, states, tolerance)
            now = friction.read_memory(sides)
            if joint.rubs and not joint.follows:  # slip is not counted from the undeformed bodies
                faults += [
                    Fault(*fault)
                    for fault in friction.faults(joint, sides, self.before[number], now, tolerance)
                ]
            self.before[number] = now
        return faults

    def read_contact(self, number):
        """Return the library's results on the meshed sides, slave first. Collective."""
        joint = self.joints[number]
        if joint.contact is None:
            return []
        ends = [end for end in (joint.slave, joint.master) if not isinstance(end, Tool)]
        return [
            readings.read(
                joint.contact,
                name,
                readings.Reader(self.bodies[end[0]].u.function_space, surface),
                self.about,
            )
            for name, end, surface in zip(NAMES, ends, self.surfaces[number], strict=False)
        ]

    def readings(self, number, sides, states, tolerance):
        """Return the faults of the library's results on a contact. Collective."""
        joint, out = self.joints[number], []
        ends = [end for end in (joint.slave, joint.master) if not isinstance(end, Tool)]
        for name, end, side, reading in zip(
            ("slave", "master"), ends, sides, self.read_contact(number), strict=False
        ):
            state = states[end[0]]
            now = state.x + state.u
            x = now if joint.finite else state.x
            expected = readings.Expected(side, x, now, x, self.about)
            alone = joint.formulation != "double-pass"
            for found in readings.faults(name, reading, expected, tolerance, joint.rubs, alone):
                out += compare(*found)
            if name == "slave" and joint.mu > 0 and not joint.finite:
                area = readings.areas_and_normals(side.own.surface, x)[0]
                held = friction.held_faults(
                    joint, sides, reading, area, self.before[number], tolerance
                )
                out += [Fault(*fault) for fault in held]
        return out

    def audit_update(self):
        """Return results that change when contact is updated without a solve. Collective."""
        out = []
        for number, joint in enumerate(self.joints):
            before = self.read_contact(number)
            if joint.contact is not None:
                joint.contact.update()
            for pair in zip(NAMES, before, self.read_contact(number), strict=False):
                for found in readings.changed(*pair):
                    out += compare(*found)
        return out

    def contact_nodes(self, i, state):
        """Return which nodes of a body are on any contact surface."""
        out = np.zeros(len(state.x), dtype=bool)
        for joint, surfaces in zip(self.joints, self.surfaces, strict=True):
            for end, surface in zip((joint.slave, joint.master), surfaces, strict=False):
                if end[0] == i:
                    out[surface.nodes] = True
        return out

    def sides(self, number, states):
        """Return the meshed sides of a contact, slave first."""
        joint, surfaces = self.joints[number], self.surfaces[number]
        ends = [end for end in (joint.slave, joint.master) if not isinstance(end, Tool)]
        if joint.follows:
            states = [dataclasses.replace(s, x=s.x + s.u, u=0 * s.u) for s in states]
        meshed = [
            Meshed(states[end[0]], surface) for end, surface in zip(ends, surfaces, strict=True)
        ]
        opponents = meshed[::-1] if len(meshed) == 2 else [joint.master]
        alone = joint.node_by_node and isinstance(joint.master, Tool)
        sides = [read_side(*pair, alone) for pair in zip(meshed, opponents, strict=True)]
        if joint.follows:
            sides = [dataclasses.replace(side, rest=side.now) for side in sides]
        return sides

    def force_tolerance(self, states):
        """Return the largest force that counts as zero."""
        total = 0.0
        for i, state in enumerate(states):
            rows = state.held | self.contact_nodes(i, state)[:, None]
            total += np.sum(state.force[rows] ** 2)
        return PART * np.sqrt(total) + LEAST * self.force

    def finite(self, states):
        values = [np.all(np.isfinite(s.u)) and np.all(np.isfinite(s.force)) for s in states]
        return [] if all(values) else [Fault("finite", np.inf, "the solution is not finite")]


def compare(check, values, bounds, text):
    """Return a fault if any value is above its bound."""
    values, bounds = np.broadcast_arrays(np.asarray(values, float), np.asarray(bounds, float))
    if values.size == 0 or np.all(values <= bounds):
        return []
    worst = np.argmax(np.where(values > bounds, values / np.maximum(bounds, 1e-300), 0))
    excess = values.flat[worst] / max(bounds.flat[worst], 1e-300)
    count = np.count_nonzero(values > bounds)
    return [
        Fault(check, float(excess), f"{text}: {values.flat[worst]:.3e}, {count} of {values.size}")
    ]


# --- Forces


def equilibrium(i, state: BodyState, on_contact, tolerance):
    """Check that the residual is zero where neither contact nor conditions act."""
    free = ~state.held & ~on_contact[:, None]
    return compare("equilibrium", np.abs(state.force[free]), tolerance, f"body {i}, residual")


def body_balance(i, body, state, on_contact, tolerance, length):
    """Check the balance of contact forces, reactions and loads of a body."""
    rows = state.held | on_contact[:, None]
    force = np.where(rows, state.force, 0.0)
    slack = tolerance * np.sqrt(len(state.x))
    faults = compare(
        "balance", np.abs(force.sum(axis=0) + body.load), slack, f"body {i}, contact + loads"
    )
    if body.moment is not None:
        arm = state.x + state.u if body.large else state.x
        moment = np.cross(arm, force).sum(axis=0) + body.moment
        lever = np.abs(arm).max() + length
        faults += compare("balance", np.abs(moment), slack * lever, f"body {i}, moments")
    return faults


def joint_faults(joint: Joint, sides: list[Side], tolerance, length):
    """Run all audits of a contact that do not need its history."""
    faults = []
    if len(sides) == 2:
        faults += pair_balance(joint, sides, tolerance, length)
    faults += reported_force(joint, sides, tolerance)
    reach = 2 * sum(side.size for side in sides)
    if joint.tied:
        return faults + tied_gaps(joint, sides, reach, length)
    for name, side in zip(("slave", "master"), sides, strict=False):
        faults += directions(name, joint, side, tolerance)
        faults += complementarity(name, joint, sides, side, tolerance, reach, length)
        faults += penetration(name, joint, sides, side, reach, length)
    return faults


def pair_balance(joint, sides, tolerance, length, arm=None):
    """Check the balance of the forces of the two sides, and of their moments up to lever × force.

    For a tie, ``arm`` is the lever of the couple of forces across the gap between its sides.
    """
    force = [side.nodal_force for side in sides]
    unknown = [np.any(side.nodal_held[:, : side.gdim], axis=0) for side in sides]
    known = ~np.any(unknown, axis=0)
    slack = tolerance * np.sqrt(sum(len(f) for f in force))
    total = force[0].sum(axis=0) + force[1].sum(axis=0)
    out = compare("action", np.abs(total[: len(known)])[known], slack, "slave + master force")
    if np.all(known):
        moment = sum(np.cross(side.nodal_x, f).sum(axis=0) for side, f in zip(sides, force))
        size = sum(np.linalg.norm(f, axis=1).sum() for f in force)
        levers = max(side.lever(joint.rubs, tolerance) for side in sides)
        if joint.tied:  # couples across the gap of the tie
            levers = arm if arm is not None else ties.arm(sides) if joint.finite else 0.0
        reach = max(np.abs(side.nodal_x).max() for side in sides) + length
        bound = slack * reach + size * levers
        out += compare("action", np.abs(moment), bound, "slave + master moment")
    return out


def reported_force(joint, sides, tolerance):
    """Check the force on the slave that the library reports."""
    if joint.reported is None:
        return []
    side, given = sides[0], joint.reported()
    known = ~np.any(side.nodal_held[:, : side.gdim], axis=0)
    own = side.nodal_force.sum(axis=0)[: side.gdim]
    slack = tolerance * np.sqrt(len(side.nodal_x))
    return compare("reported", np.abs(own - given)[known], slack, "force on the slave")


def directions(name, joint, side: Side, tolerance):
    """Check that forces push, along the normal or within Coulomb's cone about it."""
    size = np.linalg.norm(side.force, axis=1)
    apart = np.linalg.norm(side.vertices_now[:, None] - side.vertices_now, axis=2)
    near, further = (apart <= reach * side.size for reach in (1.1, 3.3))
    alone = joint.node_by_node and name == "slave"
    # Tresca's limit uses the slave's area; the area of its nodes agrees with it in the mean.
    smeared = bool(joint.at_points and joint.rubs) or (joint.shear > 0 and not alone)
    if smeared:
        size = near @ size
    # Tilts are those of facets; the pushing facet has a tilt between those of its neighbours.
    slack = side.hat_count * tolerance + (1.1 * side.tilt_at_rest + ROUNDING) * size
    if joint.follows:  # N_k moves with the end points of the rays, by the gaps between nodes
        pushed = side.vertices_now[-side.pull > slack]
        close = np.linalg.norm(side.points_now[:, None] - pushed, axis=2) <= 1.1 * side.size
        beside = side.now.facing & np.any(close, axis=1)
        between = np.max(np.abs(side.now.distance[beside]), initial=0.0)
        facets = [side.size]
        if isinstance(side.opponent, Meshed):
            corners = side.opponent.deformed
            facets.append(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).max())
        slack = slack + 12 * between / min(facets) * size  # N_k is steeper on small facets
    free = side.normal_free
    out = compare("tension", side.pull[free], slack[free], f"{name} is pulled")
    sideways = np.linalg.norm(np.where(side.held, 0.0, side.tangential), axis=1)
    limit = joint.friction_limit(side.area, -side.pull)
    if joint.viscous or (joint.shear > 0 and name == "master"):
        limit = np.full_like(limit, np.inf)
    elif smeared:
        along = near @ np.where(side.held, 0.0, side.tangential)
        sideways, limit, slack = np.linalg.norm(along, axis=1), further @ limit, near @ slack
    check, text = (
        ("cone", "friction beyond its limit on") if joint.rubs else ("normal", "force across n on")
    )
    slack = slack * (1 + joint.mu)
    return out + compare(check, (sideways - limit)[free], slack[free], f"{text} {name}")


# --- Distances


def linearisation(side: Side):
    """Return the possible difference between the method's gaps at vertices and the true gaps."""
    return 2 * (side.slide + side.initial_gap) * side.turn


def complementarity(name, joint, sides, side: Side, tolerance, reach, length):
    """Check that there is no force where all is apart within the support of a multiplier."""
    alone = joint.node_by_node and name == "slave"
    # A node that has slid over an edge keeps the partner of the undeformed state.
    gap = np.where(side.now.facing, side.now.distance, -np.inf)[: side.num_vertices]
    if not alone:
        gap[:] = np.inf
        for other in sides:
            x = other.points_now
            d = np.where(other.now.facing, other.now.distance, np.inf)
            near = np.linalg.norm(side.vertices_now[:, None] - x, axis=2)
            near = near <= reach + side.opening
            gap = np.minimum(gap, np.where(near, d, np.inf).min(axis=1))
    bound = linearisation(side) + joint.allowed_gap + CLOSE * length
    if not alone:
        bound = bound + 0.25 * side.size * side.turn
    pushed = (-side.pull > side.hat_count * tolerance) & side.normal_free
    return compare("complementarity", gap[pushed], bound[pushed], f"force on open {name}")


def penetration(name, joint, sides, side: Side, reach, length):
    """Check that no penetration exceeds what penalty, tolerance and geometry explain."""
    alone = joint.node_by_node
    if alone and name == "master":
        return []
    count = side.num_vertices if alone else len(side.points_now)
    # A point beside the other side in the undeformed state has no partner (small sliding).
    known = side.now.facing & side.rest.facing
    depth = np.where(known, -side.now.distance, -np.inf)[:count]
    pressure = max(s.pressure.max(initial=0.0) for s in sides)
    explained = SPIKE * pressure / joint.penalty if joint.penalty else joint.allowed_gap
    bound = explained + CLOSE * length + np.max(linearisation(side), initial=0.0)
    if not alone:
        bound = bound + sum(s.size for s in sides) * max(s.turn.max(initial=0.0) for s in sides)
    kept = side.near_free[:count]
    return compare("penetration", depth[kept], bound, f"{name} is inside")


def tied_gaps(joint, sides, reach, length, paired=(None, None)):
    """Check that jumps of a tie are zero in the mean: no component has one sign everywhere near.

    ``paired`` are the sides in the state from which small rotations are counted.
    """
    pressure = max((np.linalg.norm(s.force, axis=1) / s.area).max(initial=0.0) for s in sides)
    bound = CLOSE * length
    bound += SPIKE * pressure / joint.penalty if joint.penalty else joint.allowed_gap
    jumps = [ties.jump(side) for side in sides]
    # The gap vector of a tie rotates with the surfaces, in small sliding by small rotations.
    bound += 0.0 if joint.finite else max(map(ties.second_order, sides, paired))
    if joint.node_by_node:
        count = sides[0].num_vertices
        jump = jumps[0][:count][sides[0].rest.facing[:count]]
        return compare("tie", np.abs(jump).max(axis=1), bound, "jump")
    # If the slave is covered completely, and only it has multipliers, its own points are
    # sufficient.
    alone = not joint.nodal and joint.formulation != "double-pass" and np.all(sides[0].rest.facing)
    found = list(zip(jumps, sides, (1, -1), strict=False))[: 1 if alone else 2]
    jump = np.concatenate([sign * j[s.rest.facing] for j, s, sign in found])
    x = np.concatenate([s.points[s.rest.facing] for _, s, _ in found])
    if len(jump) == 0:
        return []
    near = np.linalg.norm(x[:, None] - x, axis=2) <= reach
    low = np.where(near[..., None], jump[None], np.inf).min(axis=1)
    high = np.where(near[..., None], jump[None], -np.inf).max(axis=1)
    return compare("tie", np.maximum(low, -high).max(axis=1), bound, "jump of one sign")
