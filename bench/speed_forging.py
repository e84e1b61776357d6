"""Forging, demos/forging.py, as a case of bench/speed_vs_error.py."""

import pathlib
import sys
import typing

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

import forging
from speed_cases import SIDES, Assembled, Case, Kind

#: Kind of contact that the reference is computed with, one level finer than the finest.
REFERENCE = Kind("quasi-symmetric", "overlay", "augmented-lagrangian")
#: Part of the workpiece's radius within which tractions are compared.
INNER = 0.7


class Profile(typing.NamedTuple):
    """Pressure over the radius: coefficients of 1, r², r⁴, and what is to be said of it."""

    fit: np.ndarray
    numbers: dict[str, float]


class Forging(Case):
    """A cylinder upset between dies with finer faces."""

    title = "Forging"
    text = (
        "a Norton-Hoff cylinder, upset by 10 % in two steps between elastic dies; tetrahedra of "
        "h = 5/√2ˡ mm, half of it on the faces of the dies, which are the masters. The penalty is "
        "that of the demo. Reference: the pressure over the radius, a + b r² + c r⁴ through that "
        "of a solution that is one level finer, by quasi-symmetric overlay contact with an "
        "augmented Lagrangian. The error is that of the pressure at the nodes within 70 % of the "
        "workpiece's first radius, on both dies together and on both faces of the workpiece"
    )
    refinement, reduction, num_steps = 2.0, 0.1, 2

    def __init__(self, comm, level, shared):
        self.shared = shared
        self.h = 5.0 / np.sqrt(2.0) ** level
        self.work, self.dies = forging.create_bodies(comm, self.h, self.refinement)
        spaces = [self.work.W, *(die.V for die in self.dies)]
        maps = [V.dofmap for V in spaces]
        self.dofs = sum(m.index_map.size_global * m.index_map_bs for m in maps)
        self.unknowns = [self.work.w, *(die.u for die in self.dies)]
        self.start = [u.function_space.mesh.geometry.x.copy() for u in self.unknowns]

    @classmethod
    def prepare(cls, comm, levels):
        """Coefficients of the pressure over the radius, and how far it is from nodes' and theory's.

        The closed form is that of rigid dies, under which the pressure is uniform.
        """
        scene = cls(comm, max(levels) + 1, None)
        contacts, problem, solve = scene.assemble(REFERENCE)
        solve()
        gram, right = np.zeros((3, 3)), np.zeros(3)
        for basis, pressure, weight in scene.samples(contacts, "master"):
            gram += comm.allreduce(basis.T @ (weight[:, None] * basis))
            right += comm.allreduce(basis.T @ (weight * pressure))
        scene.shared = shared = Profile(np.linalg.solve(gram, right), {})
        dt = cls.reduction * forging.HEIGHT / forging.SPEED / cls.num_steps
        height = forging.HEIGHT - forging.SPEED * (cls.num_steps - 0.5) * dt
        uniform = forging.K * np.sqrt(3) ** (forging.M + 1) * (forging.SPEED / height) ** forging.M
        numbers = {
            f"unknowns of the reference (h = {scene.h:.3g} mm)": scene.dofs,
            "distance of its nodes from a + b r² + c r⁴": scene.errors(contacts)["master"],
            "its mean pressure over that between rigid dies": float(
                gram[0] @ shared.fit / gram[0, 0] / uniform
            ),
        }
        shared.numbers.update(numbers)
        problem.destroy()
        return shared

    @staticmethod
    def describe(shared):
        return shared.numbers

    def assemble(self, kind):
        for u, x in zip(self.unknowns, self.start, strict=True):
            u.x.array[:] = 0
            u.function_space.mesh.geometry.x[:] = x
        for surface in (self.work.lower, self.work.upper, *(die.surface for die in self.dies)):
            surface.update()
        p = forging.Parameters(
            formulation=kind.formulation,
            quadrature=kind.quadrature,
            enforcement=kind.enforcement,
            reduction=self.reduction,
            num_steps=self.num_steps,
        )
        *_, contacts, problem, stepper = forging.assemble(p, self.h, self.work, self.dies)
        # One cut-back is allowed: what does not come with half the step does not come at all.
        stepper.dt_min = 0.4 * stepper.dt

        def solve():
            return sum(
                stepper.num_iterations
                for _ in stepper.run(self.reduction * forging.HEIGHT / forging.SPEED)
            )

        return Assembled(contacts, problem, solve)

    def samples(self, contacts, side):
        """1, r², r⁴ at the inner nodes this rank owns, pressure and area there, per contact."""
        for contact in contacts:
            surface = getattr(contact, side)
            r2 = np.sum(surface.node_x[:, :2] ** 2, axis=1)
            inner = r2 <= (INNER * forging.RADIUS) ** 2
            pressure = np.abs(surface.node_values(contact.traction(side))[:, 2])
            basis = np.stack([np.ones_like(r2), r2, r2**2], axis=1)
            yield basis[inner], pressure[inner], surface.node_area[inner]

    def errors(self, contacts):
        out = {}
        for side in SIDES:
            squares = np.zeros(2)
            for basis, pressure, weight in self.samples(contacts, side):
                exact = basis @ self.shared.fit
                squares += contacts[0].comm.allreduce(
                    np.array([weight @ (pressure - exact) ** 2, weight @ exact**2])
                )
            out[side] = float(np.sqrt(squares[0] / squares[1]))
        return out
