"""Scenes of bench/speed_vs_error.py: given bodies, their contact, and its error.

A scene is one mesh level of a case. ``prepare`` makes the data that all levels of a case share;
``assemble`` makes contact and problem, and is timed together with the solve that it returns.
Penalties and tolerances are the library's defaults unless stated otherwise: those that a user gets.

Errors are relative. The error of the traction, recovered from the contact forces at the nodes as
t_k = f_k / S_k, is in L2, (Σ S_k (t_k − t(x_k))² / Σ S_k t(x_k)²)^½, on each side.
"""

import pathlib
import sys
import types
import typing

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import forging
import forging_bodies
import hertz
import hertz_bodies
import patch_bodies
import two_blocks
import upsetting_convergence as upsetting

SIDES = ("slave", "master")


class Kind(typing.NamedTuple):
    """Formulation, quadrature and enforcement of contact."""

    formulation: str
    quadrature: str
    enforcement: str


class Scene:
    """One mesh level of a case; the class attributes are those of all levels.

    Attributes:
        h: Size of the cells.
        dofs: Number of unknowns.
    """

    title = ""
    levels: tuple[int, ...] = (0, 1, 2, 3)
    errors_of: tuple[str, ...] = SIDES

    def __init__(self, h, spaces):
        self.h = h
        maps = [V.dofmap for V in spaces]
        self.dofs = sum(m.index_map.size_global * m.index_map_bs for m in maps)

    @classmethod
    def prepare(cls, comm, levels):
        """Make the data that the scenes of all levels need."""

    @staticmethod
    def describe(shared):
        """Return numbers about these data for the page."""
        return {}


class Pair(Scene):
    """Two displacement-based bodies, the slave first."""

    law: qs.Law = qs.Unilateral()

    def __init__(self, bodies, surfaces, h):
        super().__init__(h, [body.V for body in bodies])
        self.bodies, self.surfaces = bodies, surfaces

    def assemble(self, kind):
        """Make contact and problem, and a function that solves and returns Newton iterations."""
        for body in self.bodies:
            body.u.x.array[:] = 0
        contact = qs.Contact(
            *self.surfaces,
            formulation=kind.formulation,
            law=self.law,
            quadrature=kind.quadrature,
            enforcement=kind.enforcement,
        )
        F, u, bcs = ([getattr(b, name) for b in self.bodies] for name in ("F", "u", "bcs"))
        problem = qs.ContactProblem(F, u, [contact], bcs)

        def solve():
            problem.solve()
            return problem.num_iterations

        return [contact], problem, solve


class Patch(Pair):
    """Tied cubes of 3·2ˡ (slave) and 5·2ˡ cells an edge, demos/patch_test.py."""

    title = "Patch test"
    law = qs.Tied()

    def __init__(self, comm, level, shared):
        rng = np.random.default_rng(0)
        bodies = []
        for i, n in enumerate((5 * 2**level, 3 * 2**level)):
            block = patch_bodies.create_block(comm, n, "hexahedron", i, i + 1, 0.25, rng)
            material = patch_bodies.MATERIALS["elastic"][i]
            bodies.append(patch_bodies.Body(block, material, i, i + 1))
        patch_bodies.set_conditions(bodies, "pressure", 0.0)
        bodies.reverse()
        surfaces = [qs.Surface(b.V, facets=b.interface) for b in bodies]
        super().__init__(bodies, surfaces, 1 / (3 * 2**level))

    def errors(self, contacts):
        out = {}
        for side, surface in zip(SIDES, self.surfaces, strict=True):
            pressure = np.abs(surface.node_values(contacts[0].traction(side))[:, 2])
            exact = np.full_like(pressure, -patch_bodies.STRESS)
            out[side] = relative_l2(surface.comm, [(pressure, exact, surface.node_area)])
        return out


def relative_l2(comm, parts):
    """Return the relative L2 error of nodal values, given as (values, exact, areas). Collective."""
    local = [[w @ (value - exact) ** 2, w @ exact**2] for value, exact, w in parts]
    squares = comm.allreduce(np.sum(local, axis=0))
    return float(np.sqrt(squares[0] / squares[1]))


class Hertz2D(Pair):
    """Cylinder on a block, demos/hertz.py; h = 0.1/2ˡ on the master and 1.5 h on the slave."""

    title = "Hertz 2D"
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
    """A quarter of a sphere on a block; h = 0.3/√2ˡ."""

    title = "Hertz 3D"
    dim, coarsest, factor = 3, 0.3, np.sqrt(2)
    levels = (1, 2, 3, 4)


class Upsetting(Pair):
    """Two tied blocks between clamped dies, demos/upsetting_convergence.py."""

    title = "Clamped upsetting"
    errors_of = (*SIDES, "energy")
    law = qs.Tied()
    ratio, grading = "3:2", 1.5

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
        return upsetting.Reference(comm, upsetting.FINEST * 2 ** max(levels), cls.grading)

    @staticmethod
    def describe(shared):
        return {"energy norm of its own error": float(shared.error)}

    def errors(self, contacts):
        pairs = list(zip(SIDES, self.bodies, strict=True))
        energy = sum(self.reference.energy_error(b.u, [side]) for side, b in pairs)
        out = {
            side: float(self.reference.traction_error(contacts[0].traction(side), side))
            for side in SIDES
        }
        return out | {"energy": float(np.sqrt(energy))}


class Cubes(Pair):
    """Two cubes, E = 3e4 and 1.3e4, under a pressure of 200: 5·2ˡ and 4·2ˡ tetrahedra an edge.

    The lower one is clamped, the top does not move sideways. The error is that of the mean
    displacement of the top.
    """

    title = "Two cubes, mean displacement"
    levels = (0, 1, 2)
    errors_of = ("displacement",)
    moduli, pressure = (3e4, 1.3e4), 200.0
    #: Cells along an edge of the reference's matching meshes, of degree 2.
    finest = 10

    def __init__(self, comm, level, shared, n=None, degree=1):
        n = n or (5 * 2**level, 4 * 2**level)
        self.reference = shared
        bodies, surfaces = [], []
        for i, (cells, modulus) in enumerate(zip(n, self.moduli, strict=True)):
            msh = two_blocks.box("tetrahedron", cells, float(i), i + 1.0)
            V = fem.functionspace(msh, ("Lagrange", degree, (3,)))
            body = types.SimpleNamespace(V=V, u=fem.Function(V))
            v = ufl.TestFunction(V)
            body.F = two_blocks.residual(body.u, v, modulus)
            if i == 0:
                body.bcs = [two_blocks.clamp(V, 0.0, 0.0)]
            else:
                top = two_blocks.facets_at(msh, 2.0)
                tags = mesh.meshtags(msh, 2, np.sort(top), np.ones(len(top), dtype=np.int32))
                ds = ufl.Measure("ds", msh, subdomain_data=tags)(1)
                body.F += self.pressure * v[2] * ds
                body.bcs = [
                    fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(j), 2, top), V.sub(j))
                    for j in range(2)
                ]
                self.mean = fem.form(-body.u[2] * ds)
            bodies.append(body)
            surfaces.append(qs.Surface(V, facets=two_blocks.facets_at(msh, 1.0)))
        super().__init__(bodies[::-1], surfaces[::-1], 1 / n[1])

    @classmethod
    def prepare(cls, comm, levels):
        """Return the mean displacement on matching meshes of degree 2."""
        scene = cls(comm, 0, None, n=(cls.finest, cls.finest), degree=2)
        *_, problem, solve = scene.assemble(
            Kind("quasi-symmetric", "overlay", "augmented-lagrangian")
        )
        solve()
        displacement = scene.displacement()
        problem.destroy()
        return displacement

    @staticmethod
    def describe(shared):
        return {"mean displacement": shared}

    def displacement(self):
        """Return the mean downward displacement of the top. Collective."""
        comm = self.bodies[0].V.mesh.comm
        return float(comm.allreduce(fem.assemble_scalar(self.mean)))

    def errors(self, contacts):
        return {"displacement": abs(self.displacement() / self.reference - 1)}


class Profile(typing.NamedTuple):
    """Pressure over the radius: coefficients of 1, r², r⁴, and numbers about the fit."""

    fit: np.ndarray
    numbers: dict[str, float]


class Forging(Scene):
    """A cylinder upset between dies with finer faces, demos/forging.py; h = 5/√2ˡ mm."""

    title = "Forging"
    refinement, reduction, num_steps = 2.0, 0.1, 2
    #: Kind of contact of the reference, one level finer than the finest level.
    reference = Kind("quasi-symmetric", "overlay", "augmented-lagrangian")
    #: Fraction of the workpiece's initial radius within which tractions are compared.
    inner = 0.7

    def __init__(self, comm, level, shared):
        h = 5.0 / np.sqrt(2.0) ** level
        self.work, self.dies = forging.create_bodies(comm, h, self.refinement)
        super().__init__(h, [self.work.W, *(die.V for die in self.dies)])
        self.shared = shared
        self.unknowns = [self.work.w, *(die.u for die in self.dies)]
        self.start = [u.function_space.mesh.geometry.x.copy() for u in self.unknowns]

    @classmethod
    def prepare(cls, comm, levels):
        """Fit the pressure over the radius; compare the fit with nodal values and with theory.

        The closed form is for rigid dies, under which the pressure is uniform.
        """
        scene = cls(comm, max(levels) + 1, None)
        contacts, problem, solve = scene.assemble(cls.reference)
        solve()
        gram, right = np.zeros((3, 3)), np.zeros(3)
        for basis, pressure, weight in scene.samples(contacts, "master"):
            gram += comm.allreduce(basis.T @ (weight[:, None] * basis))
            right += comm.allreduce(basis.T @ (weight * pressure))
        scene.shared = shared = Profile(np.linalg.solve(gram, right), {})
        dt = cls.reduction * forging.HEIGHT / forging.SPEED / cls.num_steps
        height = forging.HEIGHT - forging.SPEED * (cls.num_steps - 0.5) * dt
        uniform = forging.K * np.sqrt(3) ** (forging.M + 1) * (forging.SPEED / height) ** forging.M
        mean, distance = gram[0] @ shared.fit / gram[0, 0], scene.errors(contacts)["master"]
        shared.numbers[f"unknowns (h = {scene.h:.3g} mm)"] = scene.dofs
        shared.numbers["distance of its nodes' pressure from a + b r² + c r⁴"] = distance
        shared.numbers["mean pressure over that between rigid dies"] = float(mean / uniform)
        problem.destroy()
        return shared

    @staticmethod
    def describe(shared):
        return shared.numbers

    def assemble(self, kind):
        """Make contacts and problem, and a function that makes all steps from the first state."""
        for u, x in zip(self.unknowns, self.start, strict=True):
            u.x.array[:] = 0
            u.function_space.mesh.geometry.x[:] = x
        for surface in (self.work.lower, self.work.upper, *(die.surface for die in self.dies)):
            surface.update()
        p = forging.Parameters(**kind._asdict(), reduction=self.reduction, num_steps=self.num_steps)
        *_, contacts, problem, stepper = forging.assemble(p, self.h, self.work, self.dies)
        # Only one cut-back is allowed: if half the step fails, smaller steps fail as well.
        stepper.dt_min = 0.4 * stepper.dt
        end = self.reduction * forging.HEIGHT / forging.SPEED
        return contacts, problem, lambda: sum(stepper.num_iterations for _ in stepper.run(end))

    def samples(self, contacts, side):
        """Return 1, r², r⁴ at this rank's inner nodes, and pressure and area there, per contact."""
        for contact in contacts:
            surface = getattr(contact, side)
            r2 = np.sum(surface.node_x[:, :2] ** 2, axis=1)
            inner = r2 <= (self.inner * forging_bodies.RADIUS) ** 2
            pressure = np.abs(surface.node_values(contact.traction(side))[:, 2])
            basis = np.stack([np.ones_like(r2), r2, r2**2], axis=1)
            yield basis[inner], pressure[inner], surface.node_area[inner]

    def errors(self, contacts):
        out = {}
        for side in SIDES:
            samples = self.samples(contacts, side)
            parts = [(pressure, basis @ self.shared.fit, w) for basis, pressure, w in samples]
            out[side] = relative_l2(contacts[0].comm, parts)
        return out


CASES = {
    "patch": Patch,
    "cubes": Cubes,
    "hertz2d": Hertz2D,
    "hertz3d": Hertz3D,
    "upsetting": Upsetting,
    "forging": Forging,
}
