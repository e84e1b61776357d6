"""Set up a history in the library: bodies, tool, contact, problem and stepper."""

import numpy as np
from audit.histories import FLOWS
from audit.nodes import Nodes
from audit.rigid import FacetTool, Motion, PosedTool
from hard.bodies import Body
from scenes import WORLD, box, random_values

import ufl
from dolfinx import fem

import qsdolfinx as qs


class Actor:
    """A body of a history.

    Args:
        material: Name of the material.
        body: The library's body, for displacements or as many velocities; None for a body with
            pressures.
        V: Function space of surfaces.
        F: Residual.
        u: Unknown.
    """

    def __init__(self, material, body, V, F, u):
        self.material, self.body, self.V, self.F, self.u = material, body, V, F, u
        self.flows = material in FLOWS
        self.nodes = Nodes(u, mixed=material == "mini")
        self.start = self.nodes.places()  # on this rank
        self.bcs: list = []

    def hold(self, facets):
        """Prescribe all components by a Function, and return it."""
        value, fdim = fem.Function(self.nodes.V), self.body.gdim - 1
        if self.material == "mini":
            W = self.u.function_space.sub(0)
            dofs = fem.locate_dofs_topological((W, self.nodes.V), fdim, facets)
            self.bcs.append(fem.dirichletbc(value, dofs, W))
        else:
            dofs = fem.locate_dofs_topological(self.V, fdim, facets)
            self.bcs.append(fem.dirichletbc(value, dofs))
        return value


class Play:
    """Bodies, contact, problem and stepper of a history.

    The lower body has its base at z = -1, the upper one, less wide, stands on z = 0 with its top at
    z = 0.8; z is y in 2D. The attempts of steps are recorded in lists.
    """

    def __init__(self, history):
        self.history, self.L, self.up = history, history.L, history.gdim - 1
        self.actors = [self.block(0, -1.0, 0.0, 0.0, 1.0)]
        self.tool = self.own_tool = None
        self.center = np.zeros(3)
        if history.has_tool:
            self.make_tool()
        else:
            self.actors.append(self.block(1, 0.0, 0.8, 0.17, 0.81))
            self.center[: self.up], self.center[self.up] = 0.49 * self.L, 0.8 * self.L
        self.ends = [actor.hold(actor.end) for actor in self.actors]
        self.contact = self.make_contact()
        self.problem = qs.ContactProblem(
            [a.F for a in self.actors],
            [a.u for a in self.actors],
            [self.contact],
            [a.bcs for a in self.actors],
            linear_solver=history.solver,
        )
        self.stepper = qs.TimeStepper(
            self.problem, 1.0, self.drive, solve=self.solve, dt_min=0.01, **history.stepping
        )
        self.stepper.on_solved = self.read
        self.forms = [fem.form(a.F) for a in self.actors]
        self.refused = 0
        self.solutions: list = []
        self.tool_paired: list = []
        self.assembled: list = []

    # --- Construction

    def block(self, i, bottom, top, low, high):
        """Make body number i; its contact face is at z = 0."""
        history, L, up = self.history, self.L, self.up
        corners = [low] * up + [bottom], [high] * up + [top]
        msh = box(WORLD, history.n[i], history.cells[i], *corners, history.partitions[i])
        x, material = msh.geometry.x, history.materials[i]
        E = history.E * (history.ratio if i else 1.0)
        degree = history.degree
        body = Body(msh, E, history.nu, material == "neo", degree, rule=2 * degree + 1)
        contact, far = (top, bottom) if i == 0 else (bottom, top)
        face, end = body.facets(up, contact), body.facets(up, far)
        fade = 1 - np.abs(x[:, up]) / abs(far)
        x[:, up] += fade * random_values(msh, history.wave, history.number, 1)[:, 0]
        if i == 1:
            middle = 0.5 * (low + high)
            x[:, up] += fade * 0.5 * history.curvature * np.sum((x[:, :up] - middle) ** 2, axis=1)
            x[:, up] += history.gap
        x *= L
        V, F, u = body.V, body.F, body.u
        if material == "mini":
            W = qs.materials.mini_space(msh)
            V, u = W.sub(0), fem.Function(W)
            K, m = (fem.Constant(msh, float(value)) for value in (E / 3, history.m))
            floor = fem.Constant(msh, 1e-3 * history.depth)
            stress = qs.materials.norton_hoff(ufl.split(u)[0], K, m, floor)
            F = qs.materials.incompressible(u, stress, ufl.dx(degree=4))
        actor = Actor(material, body, V, F, u)
        actor.face, actor.end = face, end
        return actor

    def make_tool(self):
        """Make the rigid tool above z = 0, for the library and for the auditor."""
        history, L, gdim, up = self.history, self.L, self.history.gdim, self.up
        at = np.zeros(3)
        at[:up], at[up] = 0.45 * L, history.gap * L
        kind = history.materials[1]
        if kind == "plane":
            down = -np.eye(3)[up]
            self.tool = qs.RigidSurface.plane(WORLD, at[:gdim], down[:gdim])
            self.own_tool = PosedTool(at, normal=down)
        elif kind == "sphere":
            radius = L / history.curvature
            at[up] += radius
            self.tool = (
                qs.RigidSurface.sphere(WORLD, at, radius)
                if gdim == 3
                else qs.RigidSurface.cylinder(WORLD, at[:2], None, radius)
            )
            self.own_tool = PosedTool(at, radius=radius)
        else:
            x, facets = tool_facets(gdim, L, history.curvature, history.gap)
            self.tool = qs.RigidSurface.triangulated(WORLD, x[:, :gdim], facets, at[:gdim])
            self.own_tool = FacetTool(x, facets, outward_signs(x, facets, up))
        self.center = at

    def make_contact(self):
        history = self.history
        surfaces = [qs.Surface(a.V, facets=a.face) for a in self.actors]
        ends = [(s, a.flows) for s, a in zip(surfaces, self.actors, strict=True)]
        if self.tool is None and not history.swapped:
            ends.reverse()
        unknowns = tuple("velocity" if flows else "displacement" for _, flows in ends)
        options = {"sliding": "small"} | history.options
        if any(history.flows):
            options["unknown"] = unknowns if len(ends) == 2 else unknowns[0]
            options["dt"] = 1.0
        softest = history.E * (1.0 if history.has_tool else min(1.0, history.ratio))
        if history.friction == "coulomb":
            options["friction"] = qs.Coulomb(history.mu)
        elif history.friction == "tresca":
            options["friction"] = qs.Tresca(history.mu * softest)
        elif history.friction == "norton":
            speed = history.slide * self.L
            options["friction"] = qs.Norton(history.mu, softest / speed**0.3, 0.3)
            options["dt"] = 1.0
        if history.stiff is not None:
            options["penalty"] = history.stiff * softest / self.L
        options["search_radius"] = 0.5 * self.L
        master = self.tool if self.tool is not None else ends[1][0]
        law = qs.Tied() if history.tied else qs.Unilateral()
        self.softest = softest
        return qs.Contact(ends[0][0], master, law=law, **options)

    # --- Motion

    def waypoint(self, t):
        """Interpolate between the waypoints of the path."""
        path = np.array([[0, 0, 0, 0, self.history.path[0].pushed], *self.history.path])
        return [np.interp(t, np.arange(len(path)), column) for column in path.T]

    def carry(self, t):
        """Return the common rotation of all bodies."""
        angle = self.waypoint(t)[3] * self.history.carry
        axis = np.array([0.0, 0.0, 1.0]) if self.up == 1 else np.array([0.6, 0.0, 0.8])
        return Motion.about(angle * axis, np.zeros(3))

    def motion(self, i, t):
        """Return the motion of the end of body i, or of the tool."""
        if i == 0:
            return self.carry(t)
        history = self.history
        down, along, turned, _, _ = self.waypoint(t)
        shift = np.zeros(3)
        # The gap is closed on the way to the first contact; ties reach across it.
        gap = 0.0 if history.tied else history.gap
        shift[self.up] = -(down * history.depth + gap * min(max(down, 0.0) * 2, 1)) * self.L
        shift[0] = along * history.slide * self.L
        turn = Motion.about(turned * history.turn * np.array(history.axis), self.center, shift)
        return self.carry(t).after(turn)

    def force(self, t):
        """Return the downward force on the tool."""
        history = self.history
        size = self.softest * history.depth * (0.5 * self.L) ** self.up
        return size * self.waypoint(t)[4]

    def drive(self, t, dt):
        self.solutions, self.tool_paired = [], []
        for i, (actor, value) in enumerate(zip(self.actors, self.ends, strict=True)):
            x = self.motion(i, t)(actor.start)
            if actor.flows:
                before = self.motion(i, self.stepper.t)(actor.start)
                actor.nodes.set(value, (x - before) / dt)
            else:
                actor.nodes.set(value, x - actor.start)
        if self.tool is not None:
            self.drive_tool(t)

    def drive_tool(self, t):
        gdim = self.history.gdim
        now = Motion.read(self.tool.position)
        told = self.motion(1, t)
        step = told.since(self.motion(1, self.stepper.t))
        vector = step.vector()
        self.tool.rotation = vector[2:] if gdim == 2 else vector
        came = self.motion(1, self.stepper.t)(self.center)
        self.tool.displacement = (told(self.center) - came)[:gdim]
        self.started = now
        if self.history.driven:
            down = np.zeros(gdim)
            down[self.up] = -1.0
            self.tool.drive(self.force(t), down)

    def solve(self, step):
        if self.tool is not None:
            self.tool_paired.append(Motion.read(self.tool.position))
        self.problem.solve()
        self.solutions.append([a.u.x.array.copy() for a in self.actors])
        if self.history.refused == step + 1 and not self.refused:
            self.refused = 1
            raise qs.ConvergenceError(-3, [1.0], [])

    def read(self):
        """Record the forces of the bodies on the meshes of the solve."""
        self.assembled = [
            (a.nodes.gather(a.nodes.places()), *a.nodes.residual(form))
            for a, form in zip(self.actors, self.forms, strict=True)
        ]


def tool_facets(gdim, L, curvature, gap):
    """Mesh a curved face, normals down, of segments or triangles: vertices and facets."""
    line = np.linspace(-0.6, 1.5, 8 if gdim == 2 else 6)
    if gdim == 2:
        x = np.stack([line, gap + 0.5 * curvature * (line - 0.45) ** 2, 0 * line], axis=1)
        k = np.arange(len(line) - 1)
        return x * L, np.stack([k, k + 1], axis=1)
    a, b = (c.ravel() for c in np.meshgrid(line, line, indexing="ij"))
    x = np.stack([a, b, gap + 0.5 * curvature * ((a - 0.45) ** 2 + (b - 0.45) ** 2)], axis=1)
    n = len(line)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    facets = np.concatenate(
        [np.stack([k, k + 1, k + n], axis=1), np.stack([k + 1, k + n + 1, k + n], axis=1)]
    )
    return x * L, facets


def outward_signs(x, facets, up):
    """Return signs that make the facet normals, in the order of their vertices, point down."""
    corners = x[facets]
    if up == 1:
        t = corners[:, 1] - corners[:, 0]
        return -np.sign(-t[:, 0])
    return -np.sign(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2])
