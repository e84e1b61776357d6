"""Crumple strips, plates and tubes by tools until they are in self-contact, and audit them.

    python3 tests/audit/crumple.py --seeds 0:200
    python3 tests/audit/crumple.py --seeds 0:200 --sliding small
    mpirun -n 2 python3 tests/audit/crumple.py --dim 3 --seeds 0:20

The following is checked after each step, with DOLFINx and NumPy alone: no part has passed through
the body itself or through the tools; forces are only where an opposite surface is near, they push,
and they are within the cone of friction; the forces and their moments balance those on the tools;
all other nodes are in equilibrium. A scene counts as refused if the library raises an error of its
own. Ends with 1 if there are faults.
"""

import argparse
import dataclasses
import gc
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))

from audit.boundary import Boundary
from audit.run import numbers_of
from following import Body, create

import ufl
from dolfinx import fem, la

import qsdolfinx as qs

COMM = MPI.COMM_WORLD

SEED = 71

#: Errors whose messages say what to do.
REFUSALS = (qs.ConvergenceError, qs.StepError)

#: Faults that are explained by sharp edges between nodes, of which the library warns.
EXPLAINED = ("within itself", "within tool", "force on what is open", "out of the cone")

#: Number of step cut-backs at which a scene is given up.
MANY = 6

#: Young's modulus of all bodies.
E = 100.0

#: Forces that count as zero, over the modulus times the area of a facet.
NO_FORCE = 1e-6

#: The same, over the largest force at the other nodes of its facets: forces at a corner turn the
#: facets around the nodes beside it, and a point near one end of a facet acts on the other, too.
LITTLE = 1e-3

#: Allowed depth and distance over the size of facets, and the addition where facets are rotated.
DEPTH, PER_TURN = 0.1, 0.25

#: Factor on these limits for pairs that are kept while bodies move (small sliding) in a step.
KEPT = 2.0

#: Angle (radians) by which forces may be outside the cone of friction.
ANGLE = 0.1


@dataclasses.dataclass(frozen=True)
class Tool:
    """A moving plane, or cylinder along the last axis (in 2D a circle).

    Attributes:
        point: A point of the plane, or the closest point of the cylinder, at the start.
        normal: Normal towards the body.
        velocity: Displacement per unit of time.
        radius: Radius of the cylinder; 0 for a plane.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    velocity: tuple[float, ...]
    radius: float = 0.0

    def make(self):
        x, n = np.array(self.point), np.array(self.normal)
        if self.radius:
            axis = None if len(x) == 2 else (0, 0, 1)
            return qs.RigidSurface.cylinder(COMM, x - self.radius * n, axis, self.radius)
        return qs.RigidSurface.plane(COMM, x, n)

    def distance(self, x, t):
        """Return distances of points (n, d) from the tool at a time, and its normals there."""
        n, at = np.array(self.normal), np.array(self.point) + t * np.array(self.velocity)
        if not self.radius:
            return (x - at) @ n, np.broadcast_to(n, x.shape)
        r = x - (at - self.radius * n)
        if len(at) == 3:
            r = r * (1, 1, 0)
        length = np.linalg.norm(r, axis=1)
        return length - self.radius, r / length[:, None]


@dataclasses.dataclass(frozen=True)
class Scene:
    """Random parameters of a scene. The body's length, or the tube's diameter, is about 1.

    Attributes:
        number: Number of the scene.
        gdim: Dimension of space.
        shape: ``"strip"``, ``"plate"`` or ``"tube"``.
        cell: Shape of the cells.
        degree: Degree of the displacements.
        n: Numbers of cells along, across, and in 3D along the third axis.
        thickness: Thickness of the wall.
        waves: Heights and phases of the waves of its middle surface.
        turn: Angle by which everything is rotated in the plane.
        tools: Tools around the body.
        steps: Number of steps until the tools have reached their end positions.
        drag: Resistance to motion per unit volume and velocity.
        mu: Coefficient of friction in self-contact and with the tools.
        penalty: Penalty times size of facets over modulus; 0 for the augmented Lagrangian.
        sliding: ``"small"`` or ``"finite"``.
        tools_sliding: The same for contact with the tools.
        held: Velocity, along the strip, with which its ends approach each other; 0 for free ends.
    """

    number: int
    gdim: int
    shape: str
    cell: str
    degree: int
    n: tuple[int, ...]
    thickness: float
    waves: tuple[tuple[float, float], ...]
    turn: float
    tools: tuple[Tool, ...]
    steps: int
    drag: float
    mu: float
    penalty: float
    sliding: str
    tools_sliding: str = "finite"
    held: float = 0.0

    def arrays(self):
        """Return vertices and cells, on all ranks."""
        along, across = self.n[:2]
        s, q = (
            a.ravel()
            for a in np.meshgrid(
                np.linspace(0, 1, along + 1), np.linspace(-0.5, 0.5, across + 1), indexing="ij"
            )
        )
        closed = self.shape == "tube"
        if closed:
            s, q = s.reshape(along + 1, -1)[:-1].ravel(), q.reshape(along + 1, -1)[:-1].ravel()
            x = self._tube(s, q)
        else:
            x = self._sheet(s, q)
        c, sine = np.cos(self.turn), np.sin(self.turn)
        x = x @ np.array([[c, sine], [-sine, c]])
        i, j = (a.ravel() for a in np.meshgrid(np.arange(along), np.arange(across), indexing="ij"))
        count = along if closed else along + 1

        def corner(a, b):
            return ((i + a) % count) * (across + 1) + j + b

        quads = np.stack([corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)], axis=1)
        if self.gdim == 2:
            if self.cell == "quadrilateral":
                return x, quads
            odd = (i + j) % 2 == 1
            first = np.where(odd[:, None], quads[:, [0, 1, 3]], quads[:, [0, 1, 2]])
            second = np.where(odd[:, None], quads[:, [0, 3, 2]], quads[:, [1, 3, 2]])
            return x, np.concatenate([first, second])
        return self._extruded(x, quads)

    def _sheet(self, s, q):
        y, slope = np.zeros(len(s)), np.zeros(len(s))
        for k, (height, phase) in enumerate(self.waves, 1):
            y += height * np.sin(np.pi * k * s + phase)
            slope += height * np.pi * k * np.cos(np.pi * k * s + phase)
        normal = np.stack([-slope, np.ones(len(s))], axis=1)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return np.stack([s - 0.5, y], axis=1) + self.thickness * q[:, None] * normal

    def _tube(self, s, q):
        angle, radius = 2 * np.pi * s, 0.5 - self.thickness * (0.5 - q)
        for k, (height, phase) in enumerate(self.waves, 2):
            radius = radius * (1 + height * np.sin(k * angle + phase))
        return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def _extruded(self, x, quads):
        layers, count = self.n[2], len(x)
        z = np.linspace(0, layers / self.n[0] * (np.pi if self.shape == "tube" else 1), layers + 1)
        points = np.concatenate([np.column_stack([x, np.full(count, a)]) for a in z])
        hexes = np.concatenate(
            [np.hstack([quads + k * count, quads + (k + 1) * count]) for k in range(layers)]
        )
        if self.cell == "hexahedron":
            return points, hexes
        paths = ((1, 2), (1, 4), (2, 1), (2, 4), (4, 1), (4, 2))
        return points, np.concatenate([hexes[:, [0, a, a + b, 7]] for a, b in paths])


def random_scene(number, gdim=2, sliding="finite"):
    """Make the scene of a number, the same for all ranks and both kinds of sliding."""
    rng = np.random.default_rng([SEED, gdim, number])

    def real(low, high):
        return float(rng.uniform(low, high))

    turn = real(0, 2 * np.pi) if rng.random() < 0.7 else 0.0
    t, mu = real(0.03, 0.07), float(rng.choice([0.0, 0.0, 0.2, 0.4]))
    penalty = 20.0 if rng.random() < 0.25 else 0.0
    kind = rng.random()
    if gdim == 2:
        draw = _ring if kind < 0.4 else _held_strip if kind < 0.85 else _strip
    else:
        draw = _plate if kind < 0.5 else _tube
    rest = draw(rng, real, t)
    tools = tuple(_turned(tool, turn) for tool in rest.pop("tools"))
    # About the load at which the third harmonic buckles, over the whole length at velocity 1.
    t = rest["thickness"]
    drag = real(0.3, 1.0) * 9 * np.pi**2 / 12 * E * t**2
    return Scene(
        number, gdim, turn=turn, mu=mu, penalty=penalty, sliding=sliding, drag=drag, tools=tools,
        **rest,
    )  # fmt: skip


def _turned(tool, turn):
    c, s = np.cos(turn), np.sin(turn)

    def turned(v):
        return (float(c * v[0] - s * v[1]), float(s * v[0] + c * v[1]), *v[2:])

    return Tool(turned(tool.point), turned(tool.normal), turned(tool.velocity), tool.radius)


def _box(rng, real, low, high, gdim, round_share=0.3):
    """Make tools around the origin that move from half sizes (low) to other half sizes (high)."""
    out = []
    for axis in range(len(low)):
        for sign in (-1.0, 1.0):
            point, normal, velocity = np.zeros(gdim), np.zeros(gdim), np.zeros(gdim)
            point[axis], normal[axis] = sign * low[axis], -sign
            velocity[axis] = sign * (high[axis] - low[axis])
            radius = 0.0
            if rng.random() < round_share:
                radius, point[1 - axis] = real(0.4, 1.2), real(-0.05, 0.05)
            out.append(Tool(*(tuple(map(float, v)) for v in (point, normal, velocity)), radius))
    return out


def _strip(rng, real, t):
    cell, degree = str(rng.choice(["triangle", "quadrilateral"])), 1 + int(rng.random() < 0.15)
    along = round(real(0.8, 1.3) / t)
    harmonics = int(rng.integers(2, 6))
    heights = rng.normal(size=harmonics) * 0.12 / np.arange(1, harmonics + 1)
    waves = tuple((float(a), real(0, 2 * np.pi)) for a in heights)
    high = 1.05 * sum(abs(a) for a, _ in waves) + t
    # The body fills a part of the remaining box.
    half = real(0.12, 0.25)
    height = max(t / (4 * half * real(0.35, 0.6)), 1.2 * t)
    low, last = [0.52 + t, max(high, height)], [half, height]
    open_above = rng.random() < 0.3
    tools = _box(rng, real, low[:1] if open_above else low, last[:1] if open_above else last, 2)
    return {
        "shape": "strip", "cell": cell, "degree": degree, "n": (along, int(rng.integers(1, 3))),
        "thickness": t, "waves": waves, "tools": tools, "steps": 32,
    }  # fmt: skip


def _held_strip(rng, real, t):
    """Make a strip with ends fixed outside the range of the tools, which cannot push them out."""
    out = _strip(rng, real, t)
    waves = list(enumerate(out["waves"], 1))
    ends = [abs(sum(a * np.sin(np.pi * k * s + b) for k, (a, b) in waves)) for s in (0, 1)]
    tools = []
    for tool in out["tools"][2:]:
        start = abs(tool.point[1])
        stop = max(start - abs(tool.velocity[1]), max(ends) + t)
        way = max(start - stop, 0.0)
        velocity = (0.0, float(way * np.sign(tool.velocity[1])))
        tools.append(dataclasses.replace(tool, velocity=velocity))
    return out | {"tools": tools, "held": real(0.3, 0.42)}


def _ring(rng, real, t):
    cell, degree = str(rng.choice(["triangle", "quadrilateral"])), 1 + int(rng.random() < 0.15)
    along = round(real(1.8, 2.6) / t)
    waves = tuple((real(-0.12, 0.12), real(0, 2 * np.pi)) for _ in range(int(rng.integers(1, 5))))
    high = 0.5 * np.prod([1 + abs(a) for a, _ in waves]) + 0.01
    half = real(0.2, 0.5)
    height = np.pi * t / (4 * half * real(0.35, 0.6))
    last = [half, height] if rng.random() < 0.7 else [1.2, 1.1 * t]
    tools = _box(rng, real, [high, high], last, 2)
    return {
        "shape": "tube", "cell": cell, "degree": degree, "n": (along, int(rng.integers(1, 3))),
        "thickness": t, "waves": waves, "tools": tools[2 if last[0] > 1 else 0 :], "steps": 32,
    }  # fmt: skip


def _plate(rng, real, t):
    """Make a plate that is bent by a wave and pressed along, until its halves touch."""
    t *= 1.5
    cell, along = str(rng.choice(["tetrahedron", "hexahedron"])), int(rng.integers(8, 13))
    waves = ((float(real(0.12, 0.2) * rng.choice([-1, 1])), 0.0), (real(-0.06, 0.06), 0.0))
    tools = _box(rng, real, [0.53 + t, 0.4], [real(0.12, 0.18), real(0.15, 0.3)], 3)
    return {
        "shape": "plate", "cell": cell, "degree": 1, "n": (along, 1, int(rng.integers(1, 3))),
        "thickness": t, "waves": waves, "tools": tools, "steps": 24,
    }  # fmt: skip


def _tube(rng, real, t):
    """Make a tube that is pressed from two sides, or four, until its walls touch."""
    t *= 1.5
    cell, along = str(rng.choice(["tetrahedron", "hexahedron"])), int(rng.integers(12, 17))
    waves = ((real(0, 0.05), real(0, 6.28)), (real(0, 0.05), real(0, 6.28)))
    sides = [0.56, 0.56], [float(rng.choice([0.4, 0.9])), 1.1 * t]
    tools = _box(rng, real, *sides, 3, 0.4)
    tools = tools if sides[1][0] < 0.5 else tools[2:]
    return {
        "shape": "tube", "cell": cell, "degree": 1, "n": (along, 1, int(rng.integers(1, 3))),
        "thickness": t, "waves": waves, "tools": tools, "steps": 12,
    }  # fmt: skip


class Crumpled:
    """A scene, set up in the library.

    Attributes:
        body: The body.
        tools: The library's rigid tools of the scene.
        contacts: Self-contact, and contact with each of the tools.
    """

    def __init__(self, scene):
        self.scene = scene
        x, cells = scene.arrays()
        self.boundary = Boundary(x, cells, scene.cell, scene.degree)
        self.body = body = Body(create(scene.cell, x, cells), scene.degree, E)
        self.before = fem.Function(body.V)
        self.dt = fem.Constant(body.mesh, 1.0)
        dx = ufl.Measure("dx", body.mesh, metadata={"quadrature_degree": 2 * scene.degree})
        drag = fem.Constant(body.mesh, scene.drag)
        body.F += drag / self.dt * ufl.inner(body.u - self.before, body.v) * dx
        self.form = fem.form(body.F)
        self._hold_ends()
        surface = body.surface(body.boundary(lambda x: np.full(x.shape[1], True)))
        self.tools = [tool.make() for tool in scene.tools]
        h = scene.thickness
        options = {"sliding": scene.sliding}
        if scene.mu:
            options["friction"] = qs.Coulomb(scene.mu)
        if scene.penalty:
            options |= {"enforcement": "penalty", "penalty": scene.penalty * E / h}
        self.itself = qs.Contact(surface, surface, **options)
        self.contacts = [self.itself]
        options["sliding"] = scene.tools_sliding
        self.contacts += [qs.Contact(surface, tool, **options) for tool in self.tools]
        self.problem = qs.ContactProblem([body.F], [body.u], self.contacts, [self.bcs])
        limits = {"max_slip": 0.5} if scene.sliding == "small" else {}
        dt = 1 / scene.steps
        self.stepper = qs.TimeStepper(self.problem, dt, self.drive, dt_min=dt / 8, **limits)
        self._find_nodes()

    def drive(self, t, dt):
        self.dt.value = dt
        if self.scene.held:
            c, s = np.cos(self.scene.turn), np.sin(self.scene.turn)
            for constant, sign in zip(self.motion, (1, -1), strict=True):
                way = sign * self.scene.held * t
                constant.value = way * np.array([c, s, 0][: self.scene.gdim])
        for tool, own in zip(self.tools, self.scene.tools, strict=True):
            tool.displacement = dt * np.array(own.velocity)

    def _hold_ends(self):
        """Make conditions on the ends of the first and last cells, by undeformed positions."""
        self.bcs, self.motion = [], []
        if not self.scene.held:
            return
        across = self.scene.n[1] + 1
        x = self.boundary.rest
        for end in (x[:across], x[self.scene.n[0] * across :][:across]):
            a, b = end[0], end[-1]

            def on(x, a=a, b=b):
                r, e = x[:2].T - a[:2], b[:2] - a[:2]
                along = r @ e / (e @ e)
                off = np.linalg.norm(r - along[:, None] * e, axis=1)
                return (off < 1e-9) & (along > -1e-9) & (along < 1 + 1e-9)

            self.motion.append(self.body.clamp(self.body.boundary(on)))
        self.bcs = self.body.bcs

    def steps(self):
        """Make all steps; yield the faults after each step."""
        for t in self.stepper.run(1.0):
            yield self.audit(t)
            self.before.x.array[:] = self.body.u.x.array

    def destroy(self):
        self.problem.destroy()

    # --- Auditing

    def _find_nodes(self):
        V, d = self.body.V, self.scene.gdim
        owned = V.dofmap.index_map.size_local
        rest = self._gather(V.tabulate_dof_coordinates()[:owned, :d])
        nodes = self.boundary.rest_nodes()
        if self.boundary.degree == 1:
            nodes = nodes[: len(self.boundary.rest)]
        distance, self.number = cKDTree(rest).query(nodes)
        assert distance.max() < 1e-9
        self.inner = np.setdiff1d(np.arange(len(rest)), self.number[self.boundary.nodes])
        held = [bc.dof_indices()[0] // self.scene.gdim for bc in self.bcs]
        flags = np.zeros(owned, dtype=bool)
        for dofs in held:
            flags[dofs[dofs < owned]] = True
        self.is_held = self._gather(flags)

    def _gather(self, values):
        return np.concatenate(COMM.allgather(np.asarray(values)))

    def audit(self, t):
        """Return the faults at the end of a step; the same on all ranks. Collective."""
        body, boundary, scene, d = self.body, self.boundary, self.scene, self.scene.gdim
        x = self._gather(body.places)
        b = fem.assemble_vector(self.form)
        b.scatter_reverse(la.InsertMode.add)
        f = self._gather(b.array[: body.num_owned].reshape(-1, d))
        boundary.move(x[self.number])
        size = boundary.size.max()
        forces = f[self.number]
        unit = E * size ** (d - 1)
        out = compare("equilibrium", np.linalg.norm(f[self.inner], axis=1), NO_FORCE * unit)
        near = boundary.near(size)
        gap, opposite = near.gap.copy(), near.opposite.copy()
        simplex = boundary.sample_simplex
        turn = boundary.turn[simplex]
        turn = np.maximum(turn, np.where(near.other >= 0, boundary.turn[near.other], 0))
        allowed = boundary.size[simplex] * (DEPTH + PER_TURN * turn)
        allowed *= KEPT if scene.sliding == "small" else 1.0
        lost = near.inside & ~np.isfinite(gap)
        out += compare("passed through itself", lost[lost] * 1.0, 0.0)
        out += compare("within itself", np.where(near.inside, -gap, 0), allowed)
        pairs = boundary.node_simplex
        held = np.zeros(len(boundary.simplices), dtype=bool)
        held[pairs[self.is_held[self.number[pairs[:, 0]]], 1]] = True
        by_conditions = held[simplex]
        for k, tool in enumerate(scene.tools):
            distance, normal = tool.distance(boundary.points, t)
            out += compare(f"within tool {k}", np.where(by_conditions, 0, -distance), allowed)
            closer = (distance < gap) & (np.sum(normal * boundary.point_normals, axis=1) < 0)
            gap[closer], opposite[closer] = distance[closer], normal[closer]
        free = ~self.is_held
        count, per = len(boundary.simplices), len(boundary.samples)
        close = gap.reshape(count, per).min(axis=1) < size
        if not close[held].any():
            out += self._balance(x[free], f[free], unit)
        return out + self._forces(forces, gap, opposite, allowed, unit)

    def _balance(self, x, f, unit):
        """Check that forces on the body balance those on the tools, and moments likewise."""
        d, bound = self.scene.gdim, NO_FORCE * unit * len(f)
        on_tools, twist = np.zeros(d), np.zeros(1 if d == 2 else 3)
        for contact in self.contacts[1:]:
            on_tools += contact.force("master")
            twist += contact.moment("master", np.zeros(d))
        out = compare("balance", np.abs(f.sum(axis=0) + on_tools), bound)
        own = x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0] if d == 2 else np.cross(x, f)
        if "small" in (self.scene.sliding, self.scene.tools_sliding):  # slid or rotated pairs
            bound += 0.1 * unit * self.scene.thickness
        return out + compare("moments", np.abs(own.sum(axis=0) + twist), bound)

    def _forces(self, forces, gap, opposite, allowed, unit):
        """Check that forces have an opposite surface, and push."""
        boundary, out = self.boundary, []
        per = len(boundary.samples)
        count = len(boundary.simplices)
        gap, allowed = gap.reshape(count, per), allowed.reshape(count, per)
        opposite = opposite.reshape(count, per, -1)
        angle = np.arctan(self.scene.mu) + ANGLE
        for parts, node in zip(boundary.around(), boundary.nodes, strict=True):
            f = forces[node]
            size = np.linalg.norm(f)
            corners = boundary.simplices[parts].ravel()  # middles of quadrilaterals are no nodes
            beside = np.linalg.norm(forces[corners[corners < len(forces)]], axis=1).max()
            # Forces across a depth have a moment, and the nodes of a facet a couple against it.
            depth = max(0.0, -gap[parts].min()) / boundary.size[parts].min()
            none = max(10 * NO_FORCE * unit, max(LITTLE, depth) * beside)
            if size <= none or self.is_held[self.number[node]]:
                continue
            open_by = (gap[parts] - allowed[parts]).min()
            place = f"node {node} at {np.round(boundary.x[node], 4)}, force {f}"
            if open_by > 0:
                out.append(f"force on what is open by {open_by:.3g} more than allowed: {place}")
                continue
            if boundary.degree == 2:  # nodal functions have either sign
                continue
            there = opposite[parts].reshape(-1, len(f))
            there = there[~np.isnan(there[:, 0])]
            # Friction at an edge may pull on all of its facets, but is within the cone of what
            # pushes.
            is_pushed = np.any(np.arccos(np.clip(there @ f / size, -1, 1)) <= angle)
            if not is_pushed and len(there):  # or of several surfaces that push together
                parts_of, rest = nnls(there.T, f)
                is_pushed = rest <= np.tan(angle) * parts_of.sum()
            push = (boundary.normals[parts] @ f).min() / size
            if push > 0 and not is_pushed:
                out.append(f"adhesion {push:.3g}: {place}")
            ways = np.concatenate([-boundary.normals[parts], there])
            spread = np.arccos(np.clip(ways @ ways.T, -1, 1)).max()
            off = np.arccos(np.clip(ways @ f / size, -1, 1)).min() - spread / 2
            if off > angle:
                out.append(f"out of the cone by {off - angle:.3g}: {place}")
        return out


def compare(name, values, bounds):
    """Return a fault if any value is above its bound, or is not a number."""
    values = np.atleast_1d(values)
    bounds = np.broadcast_to(bounds, values.shape)
    wrong = ~(values <= bounds)
    if not wrong.any():
        return []
    i = np.argmax(np.where(wrong, values - bounds, -np.inf))
    return [f"{name}: {values[i]:.3g} > {bounds[i]:.3g} at {wrong.sum()} place(s)"]


@dataclasses.dataclass
class Outcome:
    """Outcome of a scene.

    Attributes:
        faults: Faults, each with its step.
        refused: Error raised by the library.
        steps: Number of completed steps.
        warned: Whether the library has warned of sharp edges between nodes.
        touching: Number of steps with forces of self-contact.
        seconds: Wall-clock time.
    """

    faults: list[str] = dataclasses.field(default_factory=list)
    refused: str = ""
    steps: int = 0
    warned: bool = False
    touching: int = 0
    seconds: float = 0.0

    @property
    def word(self):
        if self.faults:
            depths = all(any(text in fault for text in EXPLAINED) for fault in self.faults)
            return "warned" if self.warned and depths else "FAULT"
        return "refused" if self.refused else "good"


def run_scene(scene):
    """Run and audit one scene. Collective."""
    out, start, crumpled = Outcome(), time.perf_counter(), None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", qs.ContactWarning)
        try:
            crumpled = Crumpled(scene)
            for faults in crumpled.steps():
                out.steps += 1
                out.touching += COMM.allreduce(int(crumpled.itself.active().any()), MPI.MAX)
                out.faults += [f"step {out.steps}: {fault}" for fault in faults]
                if out.faults:
                    break
                if crumpled.stepper.num_cutbacks > MANY:
                    raise qs.StepError(f"given up after {MANY} cutbacks")
        except REFUSALS as error:
            out.refused = f"t {crumpled.stepper.t:.3f}: {error}" if crumpled else str(error)
        except Exception as error:
            out.faults.append(f"step {out.steps + 1}: {type(error).__name__}: {error}")
        finally:
            if crumpled is not None:
                crumpled.destroy()
    out.warned = COMM.allreduce(any("edge" in str(w.message) for w in caught), MPI.LOR)
    out.seconds = time.perf_counter() - start
    return out


def run(numbers, gdim=2, sliding="finite", report=None, verbose=False):
    """Run scenes one after another; count their outcomes, and the scenes with self-contact."""
    counts = {"good": 0, "refused": 0, "warned": 0, "FAULT": 0, "touching": 0}
    for i, number in enumerate(numbers):
        if i % 10 == 0:  # on all ranks at the same time: see tests/conftest.py
            gc.collect()
        scene = random_scene(number, gdim, sliding)
        outcome = run_scene(scene)
        counts[outcome.word] += 1
        counts["touching"] += outcome.touching > 0
        if report and COMM.rank == 0 and (verbose or outcome.word == "FAULT"):
            text = f"{number} {outcome.word} {outcome.seconds:.2f} s, {outcome.steps} steps, "
            lines = [text + f"{outcome.touching} touching: {scene}", *outcome.faults[:8]]
            lines += [f"refused at {outcome.refused[:300]}"] * bool(outcome.refused)
            report("\n    ".join(lines))
    return counts


def report(text):
    print(text, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=numbers_of, default=range(20), help="first:last or 3,7")
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2)
    parser.add_argument("--sliding", choices=("finite", "small"), default="finite")
    parser.add_argument("--verbose", action="store_true", help="print scenes without faults, too")
    args = parser.parse_args()
    start = time.perf_counter()
    counts = run(args.seeds, args.dim, args.sliding, report, args.verbose)
    if COMM.rank == 0:
        words = ", ".join(f"{count} {word}" for word, count in counts.items())
        seconds = time.perf_counter() - start
        print(f"{len(args.seeds)} of {args.sliding} sliding in {args.dim}D on {COMM.size} rank(s): "
              f"{words}; {seconds:.1f} s")  # fmt: skip
    sys.exit(min(counts["FAULT"], 1))


if __name__ == "__main__":
    main()
