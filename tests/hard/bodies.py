"""Make elastic bodies, pairs of them and measures of error for the hard cases."""

from mpi4py import MPI

import numpy as np
from scenes import WORLD, largest

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

NU = 0.3

#: Newton iterations of the solves since the start of a case: see ``cases.run``.
iterations: list[int] = []


class Wrong(Exception):
    """A failure of a case other than a too large error."""


def modulus(E=1.0, nu=NU):
    """Return the ratio of stress to strain for strain along one axis only."""
    return E * (1 - nu) / (1 + nu) / (1 - 2 * nu)


def lattice(cell, *lines):
    """Mesh a box with grid planes at given positions along each axis."""
    n = [len(line) - 1 for line in lines]
    create = mesh.create_rectangle if len(n) == 2 else mesh.create_box
    msh = create(WORLD, [[0.0] * len(n), [1.0] * len(n)], n, mesh.CellType[cell])
    x = msh.geometry.x
    for i, line in enumerate(lines):
        x[:, i] = np.interp(np.round(x[:, i] * n[i]), np.arange(n[i] + 1), line)
    return msh


class Body:
    """An elastic body, linear or neo-Hookean; plane strain in 2D.

    Args:
        msh: Mesh.
        E: Modulus.
        nu: Poisson's ratio.
        large: Whether the material is neo-Hookean.
        degree: Degree of the displacements.
        rule: Quadrature degree in its cells; by default the estimate of FFCx.
    """

    def __init__(self, msh, E=1.0, nu=NU, large=False, degree=1, rule=None):
        self.mesh, self.gdim = msh, msh.geometry.dim
        x = msh.geometry.x[:, : self.gdim]
        self.low = np.array([WORLD.allreduce(c.min(initial=np.inf), op=MPI.MIN) for c in x.T])
        self.high = np.array([WORLD.allreduce(c.max(initial=-np.inf), op=MPI.MAX) for c in x.T])
        self.V = fem.functionspace(msh, ("Lagrange", degree, (self.gdim,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        # Constants, so that all bodies have the same compiled forms.
        if large:
            constants = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
            law = qs.materials.neo_hookean
        else:
            constants, law = (E, nu), qs.materials.linear_elastic
        self.stress = law(self.u, *(fem.Constant(msh, float(c)) for c in constants))
        dx = ufl.dx if rule is None else ufl.dx(degree=rule)
        self.F, self.bcs = ufl.inner(self.stress, ufl.grad(self.v)) * dx, []

    def facets(self, axis, value, where=None):
        """Return boundary facets on a plane normal to an axis; ``where`` can select among them."""
        close = 1e-9 * np.max(self.high - self.low)

        def found(x):
            return (np.abs(x[axis] - value) < close) & (where is None or where(x))

        return mesh.locate_entities_boundary(self.mesh, self.gdim - 1, found)

    def hold(self, facets, value=0.0, axis=None):
        """Prescribe all components, or one, by a Function or a constant; return the value."""
        V = self.V if axis is None else self.V.sub(axis)
        if not isinstance(value, fem.Function):
            shape = (self.gdim,) if axis is None else ()
            value = fem.Constant(self.mesh, np.broadcast_to(np.asarray(value, float), shape).copy())
        dofs = fem.locate_dofs_topological(V, self.gdim - 1, facets)
        on = () if isinstance(value, fem.Function) else (V,)
        self.bcs.append(fem.dirichletbc(value, dofs, *on))
        return value

    def load(self, facets, traction):
        """Apply a traction on facets, once per body; return the value, which may be a Constant."""
        assert len(self.F.integrals()) == 1
        if not isinstance(traction, ufl.core.expr.Expr):
            traction = fem.Constant(self.mesh, np.array(traction, dtype=float))
        facets = np.sort(facets).astype(np.int32)
        tags = mesh.meshtags(self.mesh, self.gdim - 1, facets, np.ones_like(facets))
        self.loaded = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        self.F -= ufl.inner(traction, self.v) * self.loaded
        return traction

    def surface(self, axis, value):
        return qs.Surface(self.V, facets=self.facets(axis, value))

    def move(self, change):
        """Move the mesh by a function of its coordinates, before anything else uses the mesh."""
        x = self.mesh.geometry.x
        x[:, :2] += change(x[:, 0].copy(), x[:, 1].copy())


def rectangle(cells, low, high, *material, **options):
    """Make a rectangle of quadrilaterals."""
    kind = mesh.CellType.quadrilateral
    return Body(mesh.create_rectangle(WORLD, [low, high], list(cells), kind), *material, **options)


def problem(bodies, contacts, **options):
    return qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], contacts, [b.bcs for b in bodies], **options
    )


def solve(p):
    """Solve, and return the iterations; a refused solve must leave the unknowns unchanged."""
    before = [u.x.array.copy() for u in p.u]
    try:
        p.solve()
    except qs.ConvergenceError:
        kept = all([np.array_equal(u.x.array, b) for u, b in zip(p.u, before, strict=True)])
        if not WORLD.allreduce(kept, op=MPI.LAND):
            raise Wrong("a refused solve has changed the unknowns") from None
        raise
    iterations.append(p.num_iterations)
    return p.num_iterations


def difference(u, v):
    """Return the largest relative difference of the unknowns of all bodies. Collective."""
    return largest(*(a.x.array - b for a, b in zip(u, v, strict=True))) / largest(*v)


def balance(contact, length):
    """Return the imbalance of both sides' forces and moments over force × length. Collective."""
    forces = contact.force("slave"), contact.force("master")
    about = np.zeros(2)
    moments = contact.moment("slave", about), contact.moment("master", about)
    size = np.linalg.norm(forces[0])
    if size == 0:
        return 0.0
    return max(
        np.linalg.norm(forces[0] + forces[1]) / size,
        np.linalg.norm(moments[0] + moments[1]) / size / length,
    )


class Column:
    """Two stacked blocks of width and height 1, both strained along the last axis only.

    The lower block, the master, is fixed at its lower end, and the sides are guided: on any mesh
    the exact traction is uniform.

    Args:
        variant: Variant of contact.
        n: Numbers of cells of the lower and upper block across, or positions of their nodes from 0
            to 1.
        cell: Shape of the cells.
        heights: Heights of the layers of the upper block; the lower block has the reverse order.
        ratio: Modulus of the upper block over the modulus of the lower block.
        nu: Poisson's ratio of both blocks.
        gap: Distance by which the upper block is raised.
        offset: Distance by which the upper block is moved along x.
        jitter: Fraction of the cell size by which inner nodes are moved at random.
        large: Whether strains are large.
        options: Options of the contact.
    """

    def __init__(
        self,
        variant,
        n=(5, 4),
        cell="quadrilateral",
        heights=(0.0, 1 / 3, 2 / 3, 1.0),
        ratio=1.0,
        nu=NU,
        gap=0.0,
        offset=0.0,
        jitter=0.0,
        large=False,
        **options,
    ):
        self.variant, self.ratio, self.nu = variant, ratio, nu
        self.up = up = 1 if cell in ("triangle", "quadrilateral") else 2
        n = [np.linspace(0, 1, k + 1) if np.ndim(k) == 0 else k for k in n]
        heights = np.array(heights)
        layers, moduli = (np.sort(-heights), heights), (1.0, ratio)
        self.bodies = self.lower, self.upper = [
            Body(lattice(cell, *[across] * up, z), E, nu, large)
            for across, z, E in zip(n, layers, moduli, strict=True)
        ]
        for body in self.bodies:
            for axis in range(up):
                for side in (0.0, 1.0):
                    body.hold(body.facets(axis, side), axis=axis)
        self.lower.hold(self.lower.facets(up, -1.0), axis=up)
        self.top = self.upper.facets(up, 1.0)
        faces = [body.facets(up, 0.0) for body in self.bodies]
        for seed, (body, across) in enumerate(zip(self.bodies, n, strict=True)):
            perturb(body.mesh, jitter / len(across), 1 - seed)
        self.upper.mesh.geometry.x[:, up] += gap
        self.upper.mesh.geometry.x[:, 0] += offset
        master, slave = (qs.Surface(b.V, facets=f) for b, f in zip(self.bodies, faces, strict=True))
        self.contact = qs.Contact(slave, master, **(variant.options | options))

    def press(self, pressure):
        """Load the upper end."""
        return self.upper.load(self.top, [0.0, -pressure])

    def push(self, displacement):
        """Move the upper end."""
        return self.upper.hold(self.top, displacement, axis=self.up)

    def problem(self, **options):
        return problem(self.bodies, [self.contact], **options)

    def compliance(self):
        """Return the ratio of shortening to pressure, including the penalty."""
        gap = 0.0 if self.variant.augmented else 1 / self.contact.penalty
        return (1 + 1 / self.ratio) / modulus(nu=self.nu) + gap

    def error(self, pressure):
        """Return the error of a state of uniform pressure. Collective.

        Compares the forces and, on the overlay, the tractions at every node. With nodal quadrature
        the patch test fails on non-matching meshes.
        """
        errors = []
        for side, sign in (("slave", 1), ("master", -1)):
            errors.append(abs(sign * self.contact.force(side)[-1] / pressure - 1))
            if self.variant.quadrature == "overlay":
                t = getattr(self.contact, side).node_values(self.contact.traction(side))
                t[:, -1] -= sign * pressure
                errors.append(largest(t) / pressure)
        return max(errors)


def perturb(msh, amplitude, seed):
    """Move nodes along the interface and inside, but not across the boundary planes of the body."""
    if amplitude == 0:
        return
    x, gdim = msh.geometry.x, msh.geometry.dim
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(16, 3)) * 40
    moves = np.sin((x @ waves.T)[:, :, None] + rng.uniform(0, 6, (16, gdim))).mean(axis=1) * 4
    lower = WORLD.allreduce(x[:, gdim - 1].min(initial=0.0), op=MPI.MIN) < -0.5
    for axis in range(gdim):
        inner = np.ones(len(x), dtype=bool)
        for bound in (0.0, -1.0 if axis == gdim - 1 and lower else 1.0):
            inner &= np.abs(x[:, axis] - bound) > 1e-9
        moves[~inner, axis] = 0
    x[:, :gdim] += amplitude * np.clip(moves, -1, 1)


class Punch:
    """A curved punch that is pressed into a block by the displacement of its upper end.

    Args:
        variant: Variant of contact.
        unit: Length of a metre.
        E: Modulus of the block in newtons per metre²; the modulus of the punch is twice as large.
        n: Numbers of cells along the block and the punch.
        depth: Downward displacement of the end.
        options: Options of the contact.
    """

    def __init__(self, variant, unit=1.0, E=1.0, n=((32, 12), (12, 6)), depth=0.1, **options):
        L, E = unit, E / unit**2
        self.unit, self.E = unit, E
        self.block = rectangle(n[0], [-4 * L, -4 * L], [4 * L, 0.0], E)
        self.punch = rectangle(n[1], [-2 * L, 0.0], [2 * L, 2 * L], 2 * E)
        self.bodies = (self.block, self.punch)
        near, top = self.punch.facets(1, 0.0), self.punch.facets(1, 2 * L)
        self.block.hold(self.block.facets(1, -4 * L))
        self.punch.hold(top, axis=0)
        self.height = self.punch.hold(top, -depth * L, axis=1)
        self.punch.move(lambda x, y: np.stack([0 * x, x**2 / (16 * L) * (1 - y / (2 * L))], axis=1))
        options = {"search_radius": L} | variant.options | options
        master = self.block.surface(1, 0.0)
        self.contact = qs.Contact(qs.Surface(self.punch.V, facets=near), master, **options)

    def problem(self, **options):
        return problem(self.bodies, [self.contact], **options)

    def state(self):
        """Return displacements over the unit, and forces over E and the unit. Collective."""
        forces = self.contact.force("slave") / (self.E * self.unit)
        return [b.u.x.array / self.unit for b in self.bodies] + [forces]
