"""Cases of bench/speed_vs_error.py: bodies that are there, their contact, and its error.

A scene is one mesh level of a case. ``prepare`` makes what all levels of a case share;
``assemble`` makes contact and problem, and is timed with the solve that it returns; errors are
relative. Penalties and tolerances are the library's, if nothing else is said: what a user gets.

The traction is that recovered from the contact forces at the nodes, t_k = f_k / S_k, and its error
is in L2, (Σ S_k (t_k − t(x_k))² / Σ S_k t(x_k)²)^½, on each side.
"""

import pathlib
import sys
import typing

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

import hertz
import hertz_bodies
import patch_bodies
import upsetting_convergence as upsetting

SIDES = ("slave", "master")


class Kind(typing.NamedTuple):
    """One choice of how contact is made."""

    formulation: str
    quadrature: str
    enforcement: str


class Assembled(typing.NamedTuple):
    """Contacts and problem of a scene; ``solve`` returns the number of Newton iterations."""

    contacts: list[qs.Contact]
    problem: qs.ContactProblem
    solve: typing.Callable[[], int]


class Case:
    """One mesh level; the class attributes are those of all levels.

    ``measures`` maps what is compared, in words, to the errors of which it is the worst.
    """

    title = ""
    text = ""
    levels: tuple[int, ...] = (0, 1, 2, 3)
    measures: typing.ClassVar[dict[str, tuple[str, ...]]] = {"traction": SIDES}

    def __init__(self, comm, level, shared):
        """Make the bodies."""
        self.h, self.dofs = 0.0, 0

    @classmethod
    def prepare(cls, comm, levels):
        """What the scenes of all levels need."""

    @staticmethod
    def describe(shared):
        """Numbers on it for the report."""
        return {}


class Pair(Case):
    """Two bodies in displacements; subclasses set ``bodies``, the slave first, and surfaces."""

    law: qs.Law = qs.Unilateral()

    def __init__(self, bodies, surfaces, h):
        self.bodies, self.surfaces, self.h = bodies, surfaces, h
        maps = [body.V.dofmap for body in bodies]
        self.dofs = sum(m.index_map.size_global * m.index_map_bs for m in maps)

    def assemble(self, kind):
        for body in self.bodies:
            body.u.x.array[:] = 0
        contact = qs.Contact(
            *self.surfaces,
            kind.formulation,
            self.law,
            quadrature=kind.quadrature,
            enforcement=kind.enforcement,
        )
        F, u, bcs = ([getattr(b, name) for b in self.bodies] for name in ("F", "u", "bcs"))
        problem = qs.ContactProblem(F, u, [contact], bcs)

        def solve():
            problem.solve()
            return problem.num_iterations

        return Assembled([contact], problem, solve)


class Patch(Pair):
    """Tied cubes under uniform pressure, demos/patch_test.py."""

    title = "Patch test"
    text = (
        "two tied elastic cubes under uniform pressure, one layer of 5·2ˡ × 5·2ˡ (master) and "
        "3·2ˡ × 3·2ˡ (slave) hexahedra each, jittered. The exact traction is uniform. The bodies "
        "are thin, so that contact is as much of the work as it can be"
    )
    law = qs.Tied()

    def __init__(self, comm, level, shared):
        rng = np.random.default_rng(0)
        bodies = []
        for i, n in enumerate((5 * 2**level, 3 * 2**level)):
            block = patch_bodies.create_block(comm, n, "hexahedron", i, i + 1, 0.25, rng)
            material = patch_bodies.MATERIALS["elastic"][i]
            bodies.append(patch_bodies.Body(block, material, i, i + 1))
        patch_bodies.set_conditions(bodies, "pressure", 0.0)
        slave, master = bodies[::-1]
        surfaces = [qs.Surface(b.V, facets=b.interface) for b in (slave, master)]
        super().__init__((slave, master), surfaces, 1 / (3 * 2**level))

    def errors(self, contacts):
        out = {}
        for side, surface in zip(SIDES, self.surfaces, strict=True):
            traction = surface.node_values(contacts[0].traction(side))
            pressure = np.abs(traction[:, 2])
            out[side] = relative_l2(surface, pressure, np.full_like(pressure, -patch_bodies.STRESS))
        return out


def relative_l2(surface, value, exact, where=slice(None)):
    """Relative nodal error in L2. Collective."""
    local = [(surface.node_area * f**2)[where].sum() for f in (value - exact, exact)]
    squares = surface.comm.allreduce(np.array(local))
    return float(np.sqrt(squares[0] / squares[1]))


class Hertz2D(Pair):
    """Cylinder on a block, demos/hertz.py."""

    title = "Hertz 2D"
    text = (
        "an elastic cylinder on an elastic block, plane strain, triangles of h = 0.1/2ˡ at the "
        "contact (its half width is 0.96) on the master, and 1.5 h on the slave, the cylinder. "
        "The exact traction is Hertz's"
    )
    dim, coarsest, factor = 2, 0.1, 2.0

    def __init__(self, comm, level, shared):
        h = self.coarsest / self.factor**level
        self.hertz = hertz.Hertz(self.dim, "block")
        bodies = []
        for shape, sign, size in (("round", 1, 1.5 * h), ("block", -1, h)):
            msh = hertz_bodies.create_mesh(comm, shape, sign, self.dim, size, self.hertz.a)
            bodies.append(hertz_bodies.Body(msh, shape, sign))
        bodies[0].press(1)
        bodies[1].hold()
        super().__init__(bodies, [b.surface for b in bodies], h)

    def errors(self, contacts):
        return {
            side: float(hertz.errors(self.hertz, body, contacts[0].traction(side))[1])
            for side, body in zip(SIDES, self.bodies, strict=True)
        }


class Hertz3D(Hertz2D):
    """Sphere on a block."""

    title = "Hertz 3D"
    text = (
        "a sphere on a block, a quarter of both, tetrahedra of h = 0.3/√2ˡ at the contact (its "
        "radius is 0.82) on the master, and 1.5 h on the slave, the sphere. The exact traction is "
        "Hertz's"
    )
    dim, coarsest, factor = 3, 0.3, np.sqrt(2)
    levels = (1, 2, 3, 4)


class Reference(upsetting.Reference):
    """The single body; finds where its points lie on another mesh only once."""

    def __init__(self, *args):
        super().__init__(*args)
        self.found = {}

    def transfer(self, u, side):
        key = u.function_space.mesh, side
        if key not in self.found:
            self.found[key] = super().transfer(u, side)
        return self.found[key]


class Upsetting(Pair):
    """Two tied blocks between clamped dies, demos/upsetting_convergence.py."""

    title = "Clamped upsetting"
    text = (
        "two tied elastic blocks between clamped dies, plane strain, graded quadrilaterals, 6·2ˡ "
        "cells of the master to 4·2ˡ of the slave along the interface. Reference: one body with "
        "cubic elements on a mesh that contains all others"
    )
    measures: typing.ClassVar = {"energy norm": ("energy",), "traction": SIDES}
    law = qs.Tied()
    ratio = "3:2"
    grading = 1.5

    def __init__(self, comm, level, shared):
        self.reference = shared
        n = [cells * 2**level for cells in upsetting.CELLS[self.ratio]]
        low = upsetting.create_mesh(comm, n[0], -1, 0, self.grading)
        high = upsetting.create_mesh(comm, n[1], 0, 1, self.grading)
        bodies = [upsetting.Body(high), upsetting.Body(low)]
        facets = [upsetting.locate(b.mesh, 1, 0.0) for b in bodies]
        surfaces = [qs.Surface(b.V, facets=f) for b, f in zip(bodies, facets, strict=True)]
        super().__init__(bodies, surfaces, 1 / n[1])

    @classmethod
    def prepare(cls, comm, levels):
        return Reference(comm, upsetting.FINEST * 2 ** max(levels), cls.grading)

    @staticmethod
    def describe(shared):
        return {"energy norm of the reference's own error": float(shared.error)}

    def errors(self, contacts):
        pairs = list(zip(SIDES, self.bodies, strict=True))
        energy = sum(self.reference.energy_error(b.u, [side]) for side, b in pairs)
        out = {
            side: float(self.reference.traction_error(contacts[0].traction(side), side))
            for side in SIDES
        }
        return out | {"energy": float(np.sqrt(energy))}
