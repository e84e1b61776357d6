"""Random scenes for the auditor: the number of a scene defines it, on any number of ranks."""

import dataclasses

import numpy as np
from audit.auditor import AuditedBody, Auditor, Joint, Tool
from hard.bodies import Body, problem
from scenes import PARTITIONS, WORLD, box, random_values

import qsdolfinx as qs

SEED = 20

#: Movements of the upper body or tool: downward and sideways, as fractions of depth and slide.
HISTORIES = {
    "press": ((1, 0),),
    "press twice": ((0.5, 0), (1, 0)),
    "press, slide": ((1, 0), (1, 1)),
    "press, slide back": ((1, 0), (1, 1), (1, -0.5)),
    "press, lift": ((1, 0), (0.2, 0)),
    "lose contact": ((1, 0), (-1, 0), (1, 0)),
    "slide, lose contact": ((1, 0.5), (-0.5, 1), (0.8, 0.2), (1, 1)),
}


@dataclasses.dataclass(frozen=True)
class Scene:
    """Random parameters of a scene; lengths are multiples of ``L``.

    Attributes:
        number: Number of the scene.
        gdim: Dimension of space.
        cells: Cell shapes of the lower and the upper body.
        n: Numbers of cells of the two along each axis.
        degree: Degree of the displacements.
        tool: ``"none"``, or the shape of the rigid tool that replaces the upper body.
        large: Whether the material is neo-Hookean.
        loaded: Whether a traction presses the upper body, which is then fixed sideways only.
        dragged: Whether the side of the upper body, including the part in contact, moves along x
            with its top.
        symmetric: Whether x = 0, in 3D y = 0 as well, are planes of symmetry.
        swapped: Whether the lower body is the slave.
        curvature: Curvature of the lower face of the upper body, or of the sphere, in units of 1 /
            L.
        wave: Height of waves on both faces.
        gap: Initial gap.
        depth: Downward displacement of the upper body beyond the gap.
        slide: Sliding distance of the upper body.
        ratio: Modulus of the upper body over the modulus of the lower body.
        nu: Poisson's ratio of both.
        history: Name of the movements.
        tied: Whether the bodies are tied.
        mu: Coefficient of friction, 0 without.
        stiff: Penalty over modulus of the lower body / L; None for the automatic penalty.
        options: Options of the contact.
        solver: Name of the solver.
        partitions: Partitions of the two meshes.
        E: Modulus of the lower body.
        L: Unit of length.
    """

    number: int
    gdim: int
    cells: tuple[str, str]
    n: tuple[tuple[int, ...], tuple[int, ...]]
    degree: int
    tool: str
    large: bool
    loaded: bool
    dragged: bool
    symmetric: bool
    swapped: bool
    curvature: float
    wave: float
    gap: float
    depth: float
    slide: float
    ratio: float
    nu: float
    history: str
    tied: bool
    mu: float
    stiff: float | None
    options: dict
    solver: str
    partitions: tuple[str, str]
    E: float
    L: float

    def __str__(self):
        upper = f"{self.cells[1]} {self.n[1]}" if self.tool == "none" else self.tool
        o = self.options
        words = [f"{self.cells[0]} {self.n[0]}", upper, o["formulation"], o["quadrature"]]
        if "constraints" in o:
            words.append(o["constraints"])
        words += [o["enforcement"], f"P{self.degree}", self.solver, self.history]
        for name in ("large", "loaded", "dragged", "symmetric", "swapped", "tied"):
            words += [name] * getattr(self, name)
        for name in ("mu", "curvature", "wave", "gap", "depth", "ratio", "nu", "stiff", "E", "L"):
            value = getattr(self, name)
            words += [f"{name}={value:.3g}"] if value else []
        return ", ".join(words)


def random_scene(number, units=False):
    """Make the scene of a number; with unusual units or with units near 1."""
    rng = np.random.default_rng([SEED, number])
    gdim = int(rng.choice([2, 2, 3]))
    kinds = ("triangle", "quadrilateral") if gdim == 2 else ("tetrahedron", "hexahedron")
    quadrature = str(rng.choice(["nodal", "overlay"]))
    degree = 2 if quadrature == "overlay" and rng.random() < 0.3 else 1
    tool = str(rng.choice(["none", "none", "none", "plane", "sphere"]))
    formulations = ["master-slave", "quasi-symmetric", "quasi-symmetric", "double-pass"]
    formulation = str(rng.choice(formulations[: 3 if tool != "none" else 4]))
    augmented = formulation != "double-pass" and rng.random() < 0.4
    tied = bool(rng.random() < 0.2)
    loaded = tool == "none" and rng.random() < 0.2
    symmetric = bool(rng.random() < 0.3)
    histories = list(HISTORIES)[:3] if loaded or tied else list(HISTORIES)
    most = {(2, 1): 9, (2, 2): 6, (3, 1): 5, (3, 2): 3}[gdim, degree]
    large = bool(rng.random() < 0.35)
    limit = 3 if large and gdim == 3 else most  # these are assembled repeatedly
    curved = tool == "sphere" or rng.random() < 0.3
    options = {
        "formulation": formulation,
        "quadrature": quadrature,
        "enforcement": "augmented-lagrangian" if augmented else "penalty",
        "normals": None if rng.random() < 0.7 else str(rng.choice(["facet", "bisector"])),
    }
    more = np.random.default_rng([SEED, number, 2])
    if quadrature == "overlay" and not tied:
        options["constraints"] = str(more.choice(["nodes", "points"]))
    other = np.random.default_rng([SEED, number, 3])
    dragged = tool == "none" and not (tied or symmetric) and other.random() < 0.3
    solvers = ["direct", "auto", "auto", "fieldsplit"] + ["amg"] * augmented
    scale = np.random.default_rng([SEED, number, 1])
    powers = scale.uniform(-1, 1, 2) * ((12, 6) if units else (0.5, 0.5)) - (0, 3 if units else 0)
    return Scene(
        number=number,
        gdim=gdim,
        cells=tuple(str(c) for c in rng.choice(kinds, 2)),
        n=tuple(
            tuple(min(int(k), limit) for k in rng.integers(2, most + 1, gdim)) for _ in range(2)
        ),
        degree=degree,
        tool=tool,
        large=large,
        loaded=bool(loaded),
        dragged=bool(dragged),
        symmetric=symmetric,
        swapped=bool(tool == "none" and rng.random() < 0.4),
        curvature=float(rng.uniform(0.1, 0.5)) if curved else 0.0,
        wave=float(rng.choice([0, 0, 0, 0.01])),
        gap=gap_of(rng, other, tied and tool == "none"),
        depth=float(rng.uniform(0.005, 0.06 if large else 0.03)),
        slide=0.0 if symmetric else float(rng.uniform(0.01, 0.06)),
        ratio=float(10 ** rng.choice([-2, -0.3, 0, 0.3, 2])),
        nu=float(rng.choice([0.0, 0.3, 0.45])),
        history=str(rng.choice(histories)),
        tied=tied,
        mu=0.0 if tied or rng.random() < 0.5 else float(rng.uniform(0.05, 0.6)),
        stiff=None if rng.random() < 0.6 else float(10 ** rng.uniform(1, 4)),
        options=options,
        solver=str(rng.choice(solvers)),
        partitions=tuple(str(p) for p in rng.choice(list(PARTITIONS), 2)),
        E=float(10 ** powers[0]),
        L=float(10 ** powers[1]),
    )


def gap_of(rng, other, tied):
    """Return the initial gap between the bodies: ties reach across wide gaps."""
    gap = float(rng.choice([0.0, 0.0, 0.003, 0.01]))
    return float(other.uniform(0.05, 0.3)) if tied and other.random() < 0.5 else gap


class Stage:
    """Bodies, contact, problem and auditor of a scene.

    The lower body has its base at z = -1, the upper one, less wide, stands on z = 0 with its top at
    z = 0.8; z is y in 2D.
    """

    def __init__(self, scene):
        self.scene, self.L = scene, scene.L
        self.up = scene.gdim - 1
        self.bodies = [self.block(0, -1.0, 0.0, 0.0, 1.0)]
        self.tool = self.own_tool = None
        if scene.tool == "none":
            low = 0.0 if scene.symmetric else 0.17
            self.bodies.append(self.block(1, 0.0, 0.8, low, 0.81))
            self.push = self.hold_top()
        else:
            self.tool, self.own_tool = self.make_tool()
        self.contact = self.make_contact()
        self.problem = problem(self.bodies, [self.contact], solver=scene.solver)
        self.auditor = self.make_auditor()

    def block(self, i, bottom, top, low, high):
        """Make body number i; its contact face is at z = 0."""
        scene, L, up = self.scene, self.L, self.up
        corners = [low] * up + [bottom], [high] * up + [top]
        msh = box(WORLD, scene.n[i], scene.cells[i], *corners, scene.partitions[i])
        x = msh.geometry.x
        contact, far = (top, bottom) if i == 0 else (bottom, top)
        E = scene.E * (scene.ratio if i else 1.0)
        body = Body(msh, E, scene.nu, scene.large, scene.degree, rule=2 * scene.degree + 1)
        body.face, body.end = body.facets(up, contact), body.facets(up, far)
        body.side = body.facets(0, low)
        sides = [body.facets(axis, low) for axis in range(up)]
        fade = 1 - np.abs(x[:, up]) / abs(far)
        x[:, up] += fade * random_values(msh, scene.wave, scene.number, 1)[:, 0]
        if i == 1:
            middle = low if scene.symmetric else 0.5 * (low + high)
            x[:, up] += fade * 0.5 * scene.curvature * np.sum((x[:, :up] - middle) ** 2, axis=1)
            x[:, up] += scene.gap
        x *= L
        if scene.symmetric:
            for axis, side in enumerate(sides):
                body.hold(side, axis=axis)
        if i == 0:
            body.hold(body.end)
        body.traction = body.load(body.end, np.zeros(scene.gdim))
        body.area = ((high - low) * L) ** up
        body.middle = np.zeros(3)
        body.middle[:up], body.middle[up] = 0.5 * (low + high) * L, (far + i * scene.gap) * L
        return body

    def hold_top(self):
        """Fix the upper body's end; return the prescribed values, one for each component."""
        upper = self.bodies[1]
        axes = [a for a in range(self.up + 1) if not (self.scene.loaded and a == self.up)]
        self.side = upper.hold(upper.side, 0.0, axis=0) if self.scene.dragged else None
        return {axis: upper.hold(upper.end, 0.0, axis=axis) for axis in axes}

    def make_tool(self):
        """Make the rigid tool above z = 0, for the library and for the auditor."""
        scene, L = self.scene, self.L
        at = np.zeros(3)
        at[: self.up], at[self.up] = (0.0 if scene.symmetric else 0.45) * L, scene.gap * L
        if scene.tool == "plane":
            down = -np.eye(3)[self.up]
            made = qs.RigidSurface.plane(WORLD, at[: scene.gdim], down[: scene.gdim])
            return made, Tool(at, normal=down)
        radius = L / scene.curvature
        at[self.up] += radius
        make = qs.RigidSurface.sphere if scene.gdim == 3 else self.circle
        return make(WORLD, at[: scene.gdim], radius), Tool(at, radius=radius)

    def circle(self, comm, point, radius):
        return qs.RigidSurface.cylinder(comm, point, None, radius)

    def make_contact(self):
        scene = self.scene
        surfaces = [qs.Surface(b.V, facets=b.face) for b in self.bodies]
        slave, master = (
            (surfaces[0], self.tool)
            if self.tool is not None
            else surfaces
            if scene.swapped
            else surfaces[::-1]
        )
        options = {"sliding": "small"} | scene.options
        if scene.mu > 0:
            options["friction"] = qs.Coulomb(scene.mu)
        if scene.stiff is not None:
            options["penalty"] = scene.stiff * scene.E * min(1.0, scene.ratio) / self.L
        options["search_radius"] = 0.5 * self.L
        return qs.Contact(
            slave, master, law=qs.Tied() if scene.tied else qs.Unilateral(), **options
        )

    def make_auditor(self):
        scene, L = self.scene, self.L
        ends = [(i, body.face) for i, body in enumerate(self.bodies)]
        if self.tool is not None:
            ends.append(self.own_tool)
        slave, master = ends if scene.swapped or self.tool is not None else ends[::-1]
        self.joint = Joint(
            slave,
            master,
            tied=scene.tied,
            mu=scene.mu,
            formulation=scene.options["formulation"],
            nodal=scene.options["quadrature"] == "nodal",
            at_points=self.contact.settings.constraints == "points",
            follows=scene.options.get("sliding") == "finite" and not scene.tied,
            reported=lambda: self.contact.force("slave"),
            contact=self.contact,
        )
        self.audited = [AuditedBody(b.F, b.u, b.bcs, large=scene.large) for b in self.bodies]
        stiffest = scene.E * (max(1.0, scene.ratio) if self.tool is None else 1.0)
        force = stiffest * scene.depth * L**self.up
        return Auditor(self.audited, [self.joint], L, force)

    def move(self, down, along):
        """Set conditions, loads or the tool for a step."""
        scene, up = self.scene, self.up
        shift = np.zeros(3)
        shift[up] = -(down * scene.depth + (scene.gap if down > 0 else 0.0)) * self.L
        shift[0] = along * scene.slide * self.L
        if self.tool is not None:
            self.tool.displacement = shift[: scene.gdim]
            self.own_tool.shift = shift
            return
        for axis, value in self.push.items():
            value.value = shift[axis]
        if self.side is not None:
            self.side.value = shift[0]
        if scene.loaded:
            upper = self.bodies[1]
            pressure = down * scene.depth * scene.E * min(1.0, scene.ratio)
            upper.traction.value[up] = -pressure
            load = np.zeros(3)
            load[up] = -pressure * upper.area
            self.audited[1].load = load
            moment = np.cross(upper.middle, load)
            self.audited[1].moment = None if scene.large else moment

    def read_settings(self):
        """Return the penalty: the prescribed one, or the automatic one."""
        contact = self.contact
        self.joint.penalty = None if contact.model.augmented else contact.penalty
        self.joint.allowed_gap = (
            10 * contact.settings.gap_tolerance * self.L if contact.model.augmented else 0.0
        )

    def steps(self):
        """Solve step after step; yield the faults after each step."""
        path = HISTORIES[self.scene.history]
        for number, step in enumerate(path, 1):
            self.move(*step)
            self.problem.solve()
            self.read_settings()
            faults = self.auditor.audit()
            yield faults + (self.auditor.audit_update() if number == len(path) else [])

    def destroy(self):
        self.problem.destroy()
