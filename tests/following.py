"""Neo-Hookean bodies with updated contact geometry, for the tests of sliding="finite"."""

import numpy as np
from scenes import WORLD, box, clamp, create_mesh, plane, slide

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

E, NU = 100.0, 0.3


class Body:
    """A body on a mesh, initially without loads and conditions.

    Args:
        msh: The mesh.
        degree: Degree of the displacements.
        stiffness: Young's modulus.
        axisymmetric: Whether coordinates are (r, z).
    """

    def __init__(self, msh, degree=1, stiffness=E, axisymmetric=False):
        self.mesh, self.gdim, self.axisymmetric = msh, msh.geometry.dim, axisymmetric
        self.V = fem.functionspace(msh, ("Lagrange", degree, (self.gdim,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        self.mu = stiffness / 2 / (1 + NU)
        self.lmbda = stiffness * NU / (1 + NU) / (1 - 2 * NU)
        self.weight = qs.materials.axisymmetric_weight(msh) if axisymmetric else 1.0
        lame = fem.Constant(msh, self.mu), fem.Constant(msh, self.lmbda)
        self.P = qs.materials.neo_hookean(self.u, *lame, axisymmetric)
        dx = ufl.Measure("dx", msh, metadata={"quadrature_degree": 2 * degree + 1})
        self.W = qs.materials.neo_hookean_energy(self.u, *lame, axisymmetric) * self.weight * dx
        grad = qs.materials.gradient(self.v, axisymmetric)
        self.F = ufl.inner(self.P, grad) * self.weight * dx
        self.bcs = []

    def boundary(self, where):
        return mesh.locate_entities_boundary(self.mesh, self.mesh.topology.dim - 1, where)

    def surface(self, facets):
        return qs.Surface(self.V, facets=facets, axisymmetric=self.axisymmetric)

    def side(self, axis, value):
        return self.surface(plane(self.mesh, axis, value))

    def press(self, axis, value, pressure):
        """Apply a dead pressure on the side of the box with this coordinate."""
        facets = np.sort(plane(self.mesh, axis, value))
        tags = mesh.meshtags(
            self.mesh, self.mesh.topology.dim - 1, facets, np.ones(len(facets), dtype=np.int32)
        )
        ds = ufl.Measure("ds", self.mesh, subdomain_data=tags)
        self.F += fem.Constant(self.mesh, pressure) * self.v[axis] * self.weight * ds(1)

    def hold(self, axis, at, value, amount=0.0):
        """Fix one component on a side of the box."""
        self.bcs.append(slide(self.V, axis, plane(self.mesh, at, value), amount))

    def clamp(self, facets, value=None):
        """Fix a side; returns the Constant of its displacement."""
        constant = fem.Constant(
            self.mesh, np.zeros(self.gdim) if value is None else np.asarray(value, dtype=float)
        )
        dofs = fem.locate_dofs_topological(self.V, self.gdim - 1, facets)
        self.bcs.append(fem.dirichletbc(constant, dofs, self.V))
        return constant

    def set(self, displacement):
        """Set the displacement of all nodes to a function of their positions (n, gdim)."""
        self.u.interpolate(lambda x: displacement(x[: self.gdim].T).T)

    def internal_forces(self):
        """Return the internal forces at the owned nodes, (nodes, gdim). Collective."""
        b = fem.assemble_vector(fem.form(self.F))
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self.num_owned].reshape(-1, self.gdim).copy()

    @property
    def num_owned(self):
        return self.V.dofmap.index_map.size_local * self.gdim

    @property
    def places(self):
        """Return the current positions of the owned nodes, (nodes, gdim)."""
        owned = self.num_owned // self.gdim
        x = self.V.tabulate_dof_coordinates()[:owned, : self.gdim]
        return x + self.u.x.array[: self.num_owned].reshape(-1, self.gdim)

    @property
    def energy(self):
        """Return the strain energy. Collective."""
        return WORLD.allreduce(fem.assemble_scalar(fem.form(self.W)))


def problem_of(bodies, contacts, **options):
    return qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], contacts, [b.bcs for b in bodies], **options
    )


def total(values):
    """Sum over the rows of all ranks."""
    return WORLD.allreduce(np.sum(values, axis=0))


def moment(x, f):
    """Return the moment of forces at positions in 2D or 3D, about the origin. Collective."""
    if x.shape[1] == 2:
        return total(x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])
    return total(np.cross(x, f))


def rotation(angle, axis=None):
    """Return the matrix of a rotation by an angle, in 3D about an axis."""
    c, s = np.cos(angle), np.sin(angle)
    if axis is None:
        return np.array([[c, -s], [s, c]])
    a = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), a)
    return c * np.eye(3) + s * cross + (1 - c) * np.outer(a, a)


def create(cell, x, cells):
    """Make a mesh of cells, given on all ranks."""
    gdim = x.shape[1]
    mine = np.array_split(np.arange(len(cells)), WORLD.size)[WORLD.rank]
    points = np.array_split(x, WORLD.size)[WORLD.rank]
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(gdim,)))
    return create_mesh(cells[mine], points, domain)


def ring(n, radii, cell="quadrilateral", turn=0.0, wave=0.0):
    """Mesh a ring with cells around and across it, with uneven angles, rotated as a whole."""
    around, across = n
    k = np.arange(around)
    angle = 2 * np.pi * (k + 0.2 * np.sin(1.7 * k)) / around + turn
    radius = np.linspace(*radii, across + 1)
    radius = radius[:, None] * (1 + wave * np.sin(3 * angle))
    x = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=2).reshape(-1, 2)
    i, j = (a.ravel() for a in np.meshgrid(k, np.arange(across), indexing="ij"))
    first, second = i + around * j, (i + 1) % around + around * j
    quads = np.stack([first, second, first + around, second + around], axis=1)
    if cell == "triangle":
        return create(cell, x, np.concatenate([quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]]))
    return create(cell, x, quads)


def shell(n, radii, cell="hexahedron", turn=None):
    """Mesh a spherical shell of one layer: the inflated surface of a cube, n × n facets a side."""
    grid = np.linspace(-1, 1, n + 1)
    numbers, points, quads = {}, [], []

    def number(point):
        key = tuple(np.round(point, 9))
        if key not in numbers:
            numbers[key] = len(points)
            points.append(point)
        return numbers[key]

    for axis in range(3):
        for side in (-1.0, 1.0):

            def at(i, j, axis=axis, side=side):
                return number(np.insert([grid[i], grid[j]], axis, side))

            for i in range(n):
                for j in range(n):
                    quads.append([at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)])
    points, quads = np.array(points), np.array(quads)
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    if turn is not None:
        normals = normals @ turn.T
    x = np.concatenate([r * normals for r in radii])
    hexes = np.concatenate([quads, quads + len(points)], axis=1)
    if cell == "hexahedron":
        return create(cell, x, hexes)
    # Six tetrahedra along the diagonals from the lowest number of each face.
    prisms = []
    for q in quads:
        lowest = int(np.argmin(q))
        diagonal = [(q[0], q[1], q[3]), (q[0], q[2], q[3])]
        other = [(q[1], q[0], q[2]), (q[1], q[3], q[2])]
        prisms += diagonal if lowest in (0, 3) else other
    count, tets = len(points), []
    for p in prisms:
        a, b, c = sorted(p)
        low, high = (a, b, c), (a + count, b + count, c + count)
        tets += [
            (low[0], low[1], low[2], high[2]),
            (low[0], low[1], high[1], high[2]),
            (low[0], high[0], high[1], high[2]),
        ]
    return create(cell, x, np.array(tets))


def on_radius(body, radius, tolerance=0.2):
    """Return the surface of the facets whose corners have about this distance from the origin."""
    return body.surface(
        body.boundary(
            lambda x: np.abs(np.linalg.norm(x[: body.gdim], axis=0) / radius - 1) < tolerance
        )
    )


class Nested:
    """A ring in a ring, or a spherical shell in another one, that overlap by the misfit.

    The inner boundary of the inner body and the outer boundary of the outer body are clamped.
    """

    def __init__(self, cell, degree=1, n=(13, 17), misfit=0.02, wave=0.0, stiffness=E, **contact):
        self.gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        if self.gdim == 2:
            inner = ring((n[0], 1), (0.6, 1.0), cell, wave=wave)
            outer = ring((n[1], 1), (1.0 - misfit, 1.4), cell, 0.3, wave=wave)
        else:
            inner = shell(n[0], (0.6, 1.0), cell)
            outer = shell(n[1], (1.0 - misfit, 1.4), cell, rotation(0.6, (0.3, 0.2, 0.5)))
        self.bodies = [Body(msh, degree, stiffness) for msh in (inner, outer)]
        self.slave = on_radius(self.bodies[0], 1.0)
        self.master = on_radius(self.bodies[1], 1.0 - misfit)
        self.far = [
            body.boundary(lambda x, r=r: np.abs(np.linalg.norm(x, axis=0) / r - 1) < 0.2)
            for body, r in zip(self.bodies, (0.6, 1.4), strict=True)
        ]
        self.motion = [b.clamp(f) for b, f in zip(self.bodies, self.far, strict=True)]
        self.contact = qs.Contact(self.slave, self.master, **({"sliding": "finite"} | contact))

    def problem(self, **options):
        return problem_of(self.bodies, [self.contact], **options)


class Boxes:
    """Two boxes, the second on top of the first; surfaces are named by the axis normal to them.

    Args:
        cell: Cell type of both.
        n: Number of cells along each axis, of each box.
        sizes: Size along each axis, of each box.
        start: First coordinate at which the upper box begins.
        gap: Gap between the boxes.
    """

    def __init__(
        self,
        cell,
        n=((3, 3), (4, 4)),
        sizes=((1.0, 1.0), (1.0, 1.0)),
        start=0.0,
        gap=0.0,
        degree=1,
        moduli=(E, E),
        axisymmetric=False,
        radius=0.0,
        skew=0.0,
        comm=WORLD,
    ):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        axis = gdim - 1
        lows = np.zeros((2, gdim))
        lows[:, 0] = radius, radius + start
        lows[0, axis], lows[1, axis] = -sizes[0][axis], gap
        self.lows, self.highs = lows, lows + np.array(sizes)
        self.bodies = []
        for low, high, count, modulus, name in zip(
            self.lows, self.highs, n, moduli, ("forward", "backward"), strict=True
        ):
            msh = box(comm, count, cell, low, high, name)
            x = msh.geometry.x
            bubble = np.prod((x[:, :gdim] - low) * (high - x[:, :gdim]), axis=1)
            x[:, 0] += skew * bubble * np.sin(7 * x[:, 0] + 3 * x[:, axis])
            self.bodies.append(Body(msh, degree, modulus, axisymmetric))
        self.lower, self.upper = self.bodies
        self.axis = axis
        self.below = self.lower.side(axis, 0.0)
        self.above = self.upper.side(axis, gap)

    def clamp_far(self):
        """Clamp bottom and top; returns the displacement of the top."""
        self.lower.clamp(plane(self.lower.mesh, self.axis, self.lows[0, self.axis]))
        return self.upper.clamp(plane(self.upper.mesh, self.axis, self.highs[1, self.axis]))

    def problem(self, contacts, **options):
        contacts = contacts if isinstance(contacts, list) else [contacts]
        return problem_of(self.bodies, contacts, **options)


__all__ = [
    "Body", "Boxes", "Nested", "clamp", "create", "moment", "on_radius", "problem_of", "ring",
    "rotation", "shell", "slide", "total",
]  # fmt: skip


def but_for(body, facets):
    """Return all of a body's boundary facets except some."""
    everything = mesh.exterior_facet_indices(body.mesh.topology)
    return body.surface(np.setdiff1d(everything, facets))


class Dragged:
    """A tool with a flat bottom and inclined walls, pressed into a body and dragged in whole steps.

    Args:
        cells: Cells of the body.
        steep: Slope of the walls.
        along: Way of each step, after the first one, which presses the tool down.
        friction: As for ``qs.Contact``.
        down: Depth at the end of the first step.
    """

    def __init__(self, cells, steep, along, friction=None, down=0.02):
        body = Body(box(WORLD, cells, "quadrilateral", [0.0, 0.0], [1.5, 0.4], "scattered"))
        body.clamp(body.boundary(lambda x: np.isclose(x[1], 0.0)))
        out = 0.15 / steep
        x = np.array([[0.35, 0.0], [0.65, 0.0], [0.65 + out, 0.15], [0.35 - out, 0.15]])
        sides = [[0, 1], [1, 2], [2, 3], [3, 0]]
        tool = qs.RigidSurface.triangulated(WORLD, x + np.array([0.0, 0.401]), sides)
        self.contact = qs.Contact(body.side(1, 0.4), tool, sliding="finite", friction=friction)

        def drive(t, dt):
            way = np.array([[max(s - 1, 0) * along, -min(s, 1) * down] for s in (t - dt, t)])
            tool.displacement = way[1] - way[0]

        problem = problem_of([body], [self.contact])
        self.stepper = qs.TimeStepper(problem, 1.0, drive, dt_max=1.0)

    def most_iterations(self, end):
        """Run without a cut-back; returns the most iterations of a step."""
        for _ in self.stepper.run(end):
            pass
        assert self.stepper.num_cutbacks == 0
        return max(attempt.iterations for attempt in self.stepper.log)
