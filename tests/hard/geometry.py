"""Case 2: meshes of very different size, slivers, perturbed, nearly coincident and nested meshes.

Two elastic blocks of height 1 are pressed on each other between rigid walls, so that each is
strained along one axis alone, on any mesh: the exact traction is uniform. Overlay quadrature has
it at every node. At nodes, where the patch test fails on meshes that do not match, the force is
known where the slave's nodes are on the master's or the other way round, and otherwise bounded.
"""

import numpy as np
from hard.kit import Body, lattice, problem
from hard.scenes import NU, Check, largest, solve

import qsdolfinx as qs

SHORTER = 1e-2
OFFSETS = (1e-14, 1e-12, 1e-10, 1e-8, 1e-6)
#: Largest error of the force with nodal quadrature on meshes that do not match.
ROUGH = 0.1


class Column:
    """The two blocks; the upper one is the slave.

    Args:
        kind: What contact is solved with.
        cell: Shape of the cells.
        slave: Places of the slave's nodes along the interface's axes, from 0 to 1.
        master: The same of the master.
        near: Height of the cells at the interface.
        offset: By which the slave is moved along x.
        jitter: Part of the cell size by which inner nodes are moved at random.
    """

    def __init__(self, kind, cell, slave, master, near=0.5, offset=0.0, jitter=0.0):
        gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.kind, self.gdim = kind, gdim
        heights = np.array([0.0, near, 1.0])
        across = gdim - 1
        self.upper = Body(lattice(cell, *[slave] * across, heights))
        self.lower = Body(lattice(cell, *[master] * across, np.sort(-heights)))
        for body in (self.upper, self.lower):
            for axis in range(across):
                for side in (0.0, 1.0):
                    body.hold(body.at(axis, side), axis=axis)
        self.upper.hold(self.upper.at(across, 1.0), -SHORTER, axis=across)
        self.lower.hold(self.lower.at(across, -1.0), axis=across)
        faces = [body.at(across, 0.0) for body in (self.upper, self.lower)]
        for seed, body in enumerate((self.upper, self.lower)):
            perturb(body.mesh, jitter / len(slave if seed == 0 else master), seed)
        self.upper.mesh.geometry.x[:, 0] += offset
        options = kind._asdict()
        if kind.enforcement != "penalty":  # what its tolerance leaves is of no interest here
            options["gap_tolerance"] = 1e-11
        surfaces = [
            qs.Surface(b.V, facets=f) for b, f in zip((self.upper, self.lower), faces, strict=True)
        ]
        self.contact = qs.Contact(*surfaces, **options)
        self.problem = problem((self.lower, self.upper), [self.contact])

    def run(self, uniform=None):
        """Error of the tractions (of the force, unless they are known to be uniform)."""
        iterations = solve(self.problem)
        modulus = (1 - NU) / (1 + NU) / (1 - 2 * NU)
        give = 2 / modulus
        if self.kind.enforcement == "penalty":
            give += 1 / self.contact.penalty
        pressure = SHORTER / give
        forces = self.contact.force("slave"), self.contact.force("master")
        errors = [
            abs(force[-1] / sign / pressure - 1)
            for force, sign in zip(forces, (1, -1), strict=True)
        ]
        if self.kind.quadrature == "overlay" if uniform is None else uniform:
            for side in ("slave", "master"):
                t = getattr(self.contact, side).node_values(self.contact.traction(side))
                errors.append(largest(np.abs(t[:, -1]) - pressure) / pressure)
                errors.append(largest(t[:, :-1]) / pressure)
        self.problem.destroy()
        return max(errors), iterations


def perturb(msh, amplitude, seed):
    """Move nodes along the interface and inside, but not across planes that bound the body."""
    x, gdim = msh.geometry.x, msh.geometry.dim
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(16, 3)) * 40
    moves = np.sin((x @ waves.T)[:, :, None] + rng.uniform(0, 6, (16, gdim))).mean(axis=1) * 4
    for axis in range(gdim):
        inner = np.ones(len(x), dtype=bool)
        for bound in (0.0, -1.0 if axis == gdim - 1 and x[:, axis].min() < -0.5 else 1.0):
            inner &= np.abs(x[:, axis] - bound) > 1e-9
        moves[~inner, axis] = 0
    x[:, :gdim] += amplitude * np.clip(moves, -1, 1)


def uniform_lines(n):
    return np.linspace(0.0, 1.0, n + 1)


def slivers(n, ratio):
    """Every other cell is smaller by the ratio."""
    sizes = np.where(np.arange(n) % 2, 1.0 / ratio, 1.0)
    places = np.concatenate([[0.0], np.cumsum(sizes)])
    return places / places[-1]


def checks(kind):
    overlay = kind.quadrature == "overlay"
    what = "tractions" if overlay else "force"

    def case(label, allowed, *args, nodal=None, **options):
        bound = allowed if overlay else nodal or allowed
        return Check("2 meshes", label, what, bound, lambda: Column(kind, *args, **options).run())

    for slave, master in ((2, 64), (64, 2)):
        lines = uniform_lines(slave), uniform_lines(master)
        yield case(f"slave:master {slave}:{master}, 2D", 1e-8, "quadrilateral", *lines, nodal=ROUGH)
    for slave, master in ((1, 32), (32, 1)):
        lines = uniform_lines(slave), uniform_lines(master)
        yield case(f"slave:master {slave}:{master}, 3D", 1e-8, "hexahedron", *lines, nodal=ROUGH)
    for cell, n in (("triangle", (9, 8)), ("tetrahedron", (5, 4))):
        lines = slivers(n[0], 1e3), slivers(n[1], 1e3)
        yield case(f"facets 1:1000, {cell}", 1e-8, cell, *lines, nodal=ROUGH)
        lines = uniform_lines(n[0]), uniform_lines(n[1])
        yield case(f"flat cells 1:1000, {cell}", 1e-8, cell, *lines, near=1e-3 / n[0], nodal=ROUGH)
    for cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
        lines = uniform_lines(6), uniform_lines(5)
        yield case(f"perturbed, {cell}", 1e-8, cell, *lines, jitter=0.3, nodal=ROUGH)
    for cell in ("quadrilateral", "tetrahedron"):
        for offset in OFFSETS:
            lines = uniform_lines(4), uniform_lines(4)
            label, bound = f"{offset:.0e} h apart, {cell}", 1e-8 + 10 * offset
            yield case(label, bound, cell, *lines, offset=offset / 4)
        for slave, master in ((4, 12), (12, 4)):
            lines = uniform_lines(slave), uniform_lines(master)
            yield case(f"nested {slave}:{master}, {cell}", 1e-8, cell, *lines, nodal=ROUGH)
