"""Plane elastic bodies, pairs of them and checks, of which the hard cases are made."""

import dataclasses
import itertools
import typing

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
NU = 0.3


class Variant(typing.NamedTuple):
    """What a contact is solved with."""

    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"

    def __str__(self):
        return ", ".join(self)

    @property
    def options(self):
        return self._asdict()

    @property
    def balances(self):
        """Whether forces on both sides are the same but for their sign, whatever the meshes."""
        return self.formulation != "two-half-pass"

    @property
    def augmented(self):
        return self.enforcement != "penalty"


FORMULATIONS = ("quasi-symmetric", "master-slave", "double-pass", "two-half-pass")
QUADRATURES = ("overlay", "nodal")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")
VARIANTS = [Variant(*v) for v in itertools.product(FORMULATIONS, QUADRATURES, ENFORCEMENTS)]


@dataclasses.dataclass
class Check:
    """One line of the table.

    Attributes:
        case: Number and name, such as ``"1 stiffness"``.
        label: What is done.
        what: The error or invariant.
        allowed: Its largest value.
        run: Makes it; returns the error and the number of Newton iterations.
        refusal: Part of the message with which it has to be refused, if it has to.
    """

    case: str
    label: str
    what: str
    allowed: float
    run: typing.Callable[[], tuple[float, int]]
    refusal: str | None = None


def modulus(E, nu=NU):
    """Stress over strain where strain is along one axis alone."""
    return E * (1 - nu) / (1 + nu) / (1 - 2 * nu)


class Body:
    """An elastic rectangle in plane strain."""

    def __init__(self, cells, low, high, E=1.0, nu=NU, cell="quadrilateral", large=False):
        kind = mesh.CellType[cell]
        self.mesh = mesh.create_rectangle(COMM, [low, high], list(cells), kind)
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        self.E, self.nu, self.low, self.high = E, nu, np.array(low), np.array(high)
        mu, lmbda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
        if large:
            stress = qs.materials.neo_hookean(self.u, mu, lmbda)
        else:
            stress = qs.materials.linear_elastic(self.u, E, nu)
        self.stress = stress
        self.F = ufl.inner(stress, ufl.grad(self.v)) * ufl.dx
        self.bcs, self._tags = [], {}

    def facets(self, axis, value, where=None):
        """Boundary facets on a line across an axis, or those whose vertices are somewhere."""
        close = 1e-9 * np.abs(self.high - self.low).max()

        def found(x):
            return (np.abs(x[axis] - value) < close) & (where is None or where(x))

        return mesh.locate_entities_boundary(self.mesh, 1, found)

    def slide(self, axis, facets, value=0.0):
        """Hold one component; returns the Constant."""
        V = self.V.sub(axis)
        constant = fem.Constant(self.mesh, float(value))
        dofs = fem.locate_dofs_topological(V, 1, facets)
        self.bcs.append(fem.dirichletbc(constant, dofs, V))
        return constant

    def clamp(self, facets):
        """Hold both components."""
        return [self.slide(axis, facets) for axis in (0, 1)]

    def load(self, facets, traction):
        """A traction; returns the Constant."""
        constant = fem.Constant(self.mesh, np.array(traction, dtype=float))
        self.F -= ufl.inner(constant, self.v) * self.measure(facets)
        return constant

    def measure(self, facets):
        """Measure of these facets; different sets must not overlap."""
        known = self._tags
        tag = next((t for t, f in known.items() if np.array_equal(f, facets)), len(known) + 1)
        tag = COMM.allreduce(tag, op=MPI.MAX)
        known[tag] = facets
        return ufl.Measure("ds", domain=self.mesh)(tag)

    def tags(self):
        """The facets of :meth:`measure`."""
        facets = np.concatenate([np.zeros(0), *self._tags.values()]).astype(np.int32)
        values = np.repeat(list(self._tags), [len(f) for f in self._tags.values()])
        order = np.argsort(facets)
        return mesh.meshtags(self.mesh, 1, facets[order], values[order].astype(np.int32))

    def form(self):
        """The form, with the facets that its loads are on."""
        return with_tags(self.F, self.tags()) if self._tags else self.F

    def surface(self, axis, value):
        return qs.Surface(self.V, facets=self.facets(axis, value))

    def move(self, change):
        """Move the mesh by a function of its coordinates, before anything else is made of it."""
        x = self.mesh.geometry.x
        x[:, :2] += change(x[:, 0].copy(), x[:, 1].copy())


class Wrong(Exception):
    """A check that has failed in another way than by its error."""


def with_tags(form, tags):
    """The form with facet tags as the data of all its measures over facets."""
    parts = [
        part.reconstruct(subdomain_data=tags) if part.integral_type() == "exterior_facet" else part
        for part in form.integrals()
    ]
    return ufl.Form(parts)


def problem(bodies, contacts, **options):
    return qs.ContactProblem(
        [b.form() for b in bodies],
        [b.u for b in bodies],
        contacts,
        [b.bcs for b in bodies],
        **options,
    )


def solve(p):
    """Solve; a refused solve has to leave everything as it was. Returns the iterations."""
    before = [u.x.array.copy() for u in p.u]
    try:
        p.solve()
    except qs.ConvergenceError:
        kept = all([np.array_equal(u.x.array, b) for u, b in zip(p.u, before, strict=True)])
        if not COMM.allreduce(kept, op=MPI.LAND):
            raise Wrong("a refused solve has changed the unknowns") from None
        raise
    return p.num_iterations


def largest(*arrays):
    """Largest absolute value on all ranks."""
    local = max((float(np.abs(a).max(initial=0.0)) for a in arrays), default=0.0)
    return COMM.allreduce(local, op=MPI.MAX)


def difference(u, v):
    """Largest difference of the unknowns of all bodies, relative to their size. Collective."""
    size = largest(*(b.x.array if hasattr(b, "x") else b for b in v))
    return largest(*(a.x.array - b for a, b in zip(u, v, strict=True))) / size


def traction_error(contact, pressure, axis=1):
    """Largest deviation of the traction on both sides from a uniform pressure, relative.

    Nodes that are covered in part carry less, and are left out. Collective.
    """
    errors = [0.0]
    for side in ("slave", "master"):
        surface = getattr(contact, side)
        t = surface.linear.node_values(contact.traction(side))
        errors.append(largest(np.abs(t[:, axis]) - pressure) / pressure)
    return max(errors)


def balance(contact, length):
    """Forces and moments of the two sides against each other, over force × length. Collective."""
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
    """Two rectangles of width 1 and height 1 on each other, both strained along y alone.

    The lower one, the master, is held at its lower end. Sides are guided. In units of length.
    """

    def __init__(
        self, variant, ratio=1.0, nu=NU, n=(5, 4), gap=0.0, unit=1.0, E=1.0, large=False, **options
    ):
        L = unit
        self.lower = Body((n[0], 3), [0.0, -L], [L, 0.0], E, nu, large=large)
        self.upper = Body((n[1], 3), [0.0, 0.0], [L, L], E * ratio, nu, large=large)
        for body in (self.lower, self.upper):
            for x in (0.0, L):
                body.slide(0, body.facets(0, x))
        self.lower.slide(1, self.lower.facets(1, -L))
        self.top = self.upper.facets(1, L)
        bottom = self.upper.facets(1, 0.0)
        self.upper.move(lambda x, y: np.stack([0 * x, gap + 0 * y], axis=1))
        self.variant, self.E, self.ratio, self.nu, self.L = variant, E, ratio, nu, L
        self.contact = qs.Contact(
            qs.Surface(self.upper.V, facets=bottom),
            self.lower.surface(1, 0.0),
            **(variant.options | options),
        )
        self.bodies = (self.lower, self.upper)

    def press(self, pressure):
        """Load the upper end."""
        return self.upper.load(self.top, [0.0, -pressure])

    def push(self, displacement):
        """Move the upper end."""
        return self.upper.slide(1, self.top, displacement)

    def problem(self, **options):
        self.made = problem(self.bodies, [self.contact], **options)
        return self.made

    def compliance(self):
        """Shortening over pressure, the penalty's included."""
        M = modulus(self.E, self.nu)
        gap = 0.0 if self.variant.augmented else 1 / self.contact.penalty
        return self.L / M * (1 + 1 / self.ratio) + gap

    def error(self, pressure):
        """What is wrong with a state of uniform pressure.

        On the overlay the traction at every node; at nodes, where the patch test fails on meshes
        that do not match, the force.
        """
        if self.variant.quadrature == "overlay":
            return traction_error(self.contact, pressure)
        force = self.contact.force("slave")[1] / self.L
        return abs(force / pressure - 1)
