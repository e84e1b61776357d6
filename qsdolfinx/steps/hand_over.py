"""Create the next scene after a remeshing, and transfer fields and history variables."""

from __future__ import annotations

import typing
import warnings

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.messages import ContactWarning
from qsdolfinx.contact import multipliers
from qsdolfinx.materials import axisymmetric_weight
from qsdolfinx.remeshing.contact_values import ContactValues, integral
from qsdolfinx.remeshing.remesh import Remeshed, RemeshReport, remesh
from qsdolfinx.remeshing.transfer import transfer
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.solve.snes import ConvergenceError
from qsdolfinx.steps.remeshing import Remeshing
from qsdolfinx.steps.scene import Scene
from qsdolfinx.steps.staggered import Staggered

Array = npt.NDArray[np.float64]

#: Change of contact forces, over the largest force, above which there is a warning. Less is the
#: error of usual meshes; with much more, forces jump unseen.
JUMP = 0.005


class RemeshingReport(typing.NamedTuple):
    """Report of a remeshing in time steps.

    Attributes:
        step: Number of steps made before.
        t: Time.
        why: Criterion that caused the remeshing.
        bodies: Report of the new mesh of each body; None if the body has kept its mesh.
        multipliers: Integral of the multipliers of each contact before and after the transfer,
            shape (2, columns).
        forces: Force on the slave of each contact in equilibrium on the old and on the new mesh,
            shape (2, gdim); NaN where no equilibrium was found.
        energy: Values of ``energy`` of :class:`qs.Remeshing` on the old and on the new mesh; None
            without it.
    """

    step: int
    t: float
    why: str
    bodies: tuple[RemeshReport | None, ...]
    multipliers: tuple[Array, ...]
    forces: tuple[Array, ...]
    energy: tuple[float, float] | None

    @property
    def volume_change(self) -> float:
        """Largest relative change of a body's volume."""
        return max(abs(body.volume_change) for body in self.bodies if body is not None)

    @property
    def force_jump(self) -> float:
        """Largest change of a force over the largest force; NaN if a force is not known."""
        if not self.forces:
            return 0.0
        largest = max(float(np.linalg.norm(force, axis=1).max()) for force in self.forces)
        change = max(float(np.linalg.norm(force[1] - force[0])) for force in self.forces)
        return change / largest if largest > 0 else 0.0

    @property
    def num_cells(self) -> int:
        """Number of cells of the new meshes."""
        return sum(body.num_cells for body in self.bodies if body is not None)

    def __str__(self) -> str:
        made = "; ".join(str(body) for body in self.bodies if body is not None)
        return f"t = {self.t:g}: {self.why}: {made}; forces changed by {self.force_jump:.2%}"


class _Balance(typing.NamedTuple):
    """Equilibrium of a scene at its present positions.

    Attributes:
        unknowns: Solution of each body.
        contacts: History variables of the contacts.
        forces: Forces on the slave of each contact; None if there is no equilibrium.
    """

    unknowns: list[Array]
    contacts: list[ContactValues]
    forces: list[Array] | None


class HandOver:
    """Create the next scene, with new meshes.

    Args:
        remeshing: Settings of the remeshing.
        scene: The present scene.
        prepare: Sets loads and motions of the coming step, and returns its Δt.
        solve: Solves the problem of a scene.
        scene_of: Creates the scene of a problem.
    """

    def __init__(
        self,
        remeshing: Remeshing,
        scene: Scene,
        prepare: typing.Callable[[], float],
        solve: typing.Callable[[Scene], None],
        scene_of: typing.Callable[[ContactProblem, Staggered | None], Scene],
    ) -> None:
        self._remeshing, self._old = remeshing, scene
        self._prepare, self._solve, self._scene_of = prepare, solve, scene_of
        self._comm = scene.problem.comm

    def __call__(self, why: str, step: int, t: float) -> tuple[Scene, RemeshingReport]:
        """Create new meshes and the problem on them, and find its equilibrium. Collective.

        Returns:
            The new scene, and a report of the changes.

        Raises:
            RemeshError: If no valid mesh can be created.
            ConvergenceError: If there is no equilibrium on the new mesh.
            ValueError: If ``build`` returns a problem with other bodies, contacts or tools.
        """
        old, remeshing = self._old, self._remeshing
        made = [self._new_mesh(i) for i in range(len(old.motions))]
        before = self._balance(old, must=False)
        fields, energy = self._fields(), self._energy()
        meshes = [
            motion.mesh if body is None else body.mesh
            for motion, body in zip(old.motions, made, strict=True)
        ]
        known = remeshing.facet_tags or [None for _ in meshes]
        tags = [
            kept if body is None else body.facet_tags
            for kept, body in zip(known, made, strict=True)
        ]
        with warnings.catch_warnings():
            # Penetration of new nodes on old facets is resolved here.
            warnings.filterwarnings("ignore", "initial_overclosure", ContactWarning)
            built = remeshing.build(meshes, tags)
        problem, staggered = built if isinstance(built, tuple) else (built, None)
        self._check(problem, meshes)
        self._check_staggered(staggered)
        new = self._scene_of(problem, staggered)
        self._carry_staggered(new)
        self._carry_unknowns(new, before, made)
        self._carry_fields(fields, self._fields(), made)
        integrals = []
        for contact, kept in zip(problem.contacts, before.contacts, strict=True):
            kept.hand_over(contact.model)
            integrals.append(np.array([kept.totals[0], integral(contact.model.gaps[0])]))
        after = self._balance(new, must=True)
        for i, flows in enumerate(new.in_velocity):
            if flows:
                new.motions[i].u.x.array[:] = new.rates[i] = after.unknowns[i]
        remeshing.facet_tags = tags
        report = RemeshingReport(
            step,
            t,
            why,
            tuple(None if body is None else body.report for body in made),
            tuple(integrals),
            _both(before, after),
            None if energy is None else (energy, self._energy() or 0.0),
        )
        _advise(report)
        return new, report

    def _new_mesh(self, i: int) -> Remeshed | None:
        """New mesh of a velocity-based body; other bodies keep their meshes."""
        if not self._old.in_velocity[i]:
            return None
        msh, remeshing = self._old.motions[i].mesh, self._remeshing
        tags = None if remeshing.facet_tags is None else remeshing.facet_tags[i]
        return remesh(
            msh,
            remeshing.size_for(msh),
            tags,
            axisymmetric=remeshing.axisymmetric,
            feature_angle=remeshing.feature_angle,
            gradation=remeshing.gradation,
            min_quality=remeshing.min_quality,
            mesher=remeshing.mesher,
        )

    def _fields(self) -> dict[str, fem.Function]:
        """Functions to be transferred, as the user's function returns them now. Collective."""
        with collective_errors(self._comm):
            found = self._remeshing.fields()
            fits = isinstance(found, typing.Mapping) and all(
                isinstance(function, fem.Function) for function in found.values()
            )
            require(fits, "fields: must return a dictionary of dolfinx.fem.Function", TypeError)
        return dict(found)

    def _energy(self) -> float | None:
        form = None if self._remeshing.energy is None else self._remeshing.energy()
        if form is None:
            return None
        with collective_errors(self._comm):
            require(isinstance(form, ufl.Form), "energy: must return a form of UFL", TypeError)
        return float(self._comm.allreduce(fem.assemble_scalar(fem.form(form)), op=MPI.SUM))

    def _balance(self, scene: Scene, must: bool) -> _Balance:
        """Find the equilibrium of a scene as it is, without changing the scene. Collective.

        Args:
            scene: The scene.
            must: Whether to raise an error if there is none.
        """
        problem, start = scene.problem, scene.snapshot()
        models = [contact.model for contact in problem.contacts]
        forces = None
        with problem.one_step(watch=False):
            try:
                dt = self._prepare()
                for contact in problem.contacts:
                    if contact.dt is not None:
                        contact.set_dt(dt)
                scene.pairings_after(0.0).begin(dt, start, scene.rates, scene.tool_rates)
                start.restore_multipliers()
                try:
                    self._solve(scene)
                    forces = [contact.force("slave") for contact in problem.contacts]
                except ConvergenceError:
                    if must:
                        raise
                    start.restore_multipliers()
                unknowns = [motion.u.x.array.copy() for motion in scene.motions]
                contacts = [ContactValues.of(model) for model in models]
                kept = [multipliers.on_nodes(model.parts) for model in models]
            finally:
                start.restore()
        if forces is None:
            unknowns = [rate.copy() for rate in scene.rates]
        elif must:
            for model, values in zip(models, kept, strict=True):
                multipliers.set_on_nodes(model.parts, values)
        return _Balance(unknowns, contacts, forces)

    def _check(self, problem: ContactProblem, meshes: list[mesh.Mesh]) -> None:
        """Raise an error for a problem that differs in more than its meshes. Collective."""
        old = self._old
        with collective_errors(self._comm):
            fits = isinstance(problem, ContactProblem)
            require(fits, "build: must return a ContactProblem", TypeError)
            counts = len(problem.u) == len(meshes) and problem.unknowns == old.problem.unknowns
            require(counts, "build: the problem must have the same bodies, with the same unknowns")
            for i, (u, msh) in enumerate(zip(problem.u, meshes, strict=True)):
                on_mesh = u.function_space.mesh is msh
                require(on_mesh, f"build: u[{i}] must be on the mesh that build is given for it")
            before, after = old.problem.contacts, problem.contacts
            require(len(before) == len(after), "build: the problem must have the same contacts")
            require(
                problem.sides == old.problem.sides, "build: contacts must be of the same bodies"
            )
            for i, (first, second) in enumerate(zip(before, after, strict=True)):
                name = first.model.called(i)
                same = first.master.tools == second.master.tools
                require(same, f"build: {name} must have the same rigid tool as before")
                alike = len(first.model.parts) == len(second.model.parts)
                require(alike, f"build: {name} must have the same formulation and friction")

    def _check_staggered(self, staggered: typing.Any) -> None:
        old = self._old.staggered
        with collective_errors(self._comm):
            text = "build: must return a pair of a problem and its qs.Staggered if there was one"
            require((staggered is None) == (old is None), text)
            if old is not None:
                require(isinstance(staggered, Staggered), text, TypeError)
                require(len(staggered.before) == len(old.before), f"{text}, of as many unknowns")

    def _carry_staggered(self, new: Scene) -> None:
        """Transfer the temperatures. Collective."""
        old = self._old.staggered
        if old is None or new.staggered is None:
            return
        for before, after in zip(old.before, new.staggered.before, strict=True):
            self._carry_field(before, after)
            if after.function_space.mesh is not before.function_space.mesh:
                self._keep_integral(before, after)
        new.staggered.begin()

    def _keep_integral(self, old: fem.Function, new: fem.Function) -> None:
        """Add a constant to a temperature to conserve the heat. Collective."""
        weights = [self._weight(f.function_space.mesh) for f in (old, new)]
        forms = [w * f * ufl.dx for w, f in zip(weights, (old, new), strict=True)]
        forms.append(weights[1] * ufl.dx(new.function_space.mesh))
        local = np.array([fem.assemble_scalar(fem.form(form)) for form in forms])
        before, after, volume = self._comm.allreduce(local, op=MPI.SUM)
        new.x.array[:] += (before - after) / volume

    def _weight(self, msh: mesh.Mesh) -> typing.Any:
        return axisymmetric_weight(msh) if self._remeshing.axisymmetric else 1.0

    def _carry_unknowns(
        self, new: Scene, before: _Balance, made: typing.Sequence[Remeshed | None]
    ) -> None:
        old = self._old
        new.tool_rates = list(old.tool_rates)
        for i, body in enumerate(made):
            u, u_old = new.motions[i].u, old.motions[i].u
            if body is None:
                u.x.array[:] = u_old.x.array
                new.rates[i], new.missed[i] = old.rates[i].copy(), old.missed[i].copy()
                continue
            rate = fem.Function(u_old.function_space)
            rate.x.array[:] = before.unknowns[i]
            found = transfer(rate, u.function_space)
            u.x.array[:] = found.x.array
            new.rates[i] = found.x.array.copy()

    def _carry_fields(
        self,
        old: dict[str, fem.Function],
        new: dict[str, fem.Function],
        made: typing.Sequence[Remeshed | None],
    ) -> None:
        gone = [m.mesh for m, body in zip(self._old.motions, made, strict=True) if body is not None]
        with collective_errors(self._comm):
            missing = sorted(old.keys() ^ new.keys())
            require(not missing, f"fields: must have the same names after build; not {missing}")
            for name, function in new.items():
                here = all(function.function_space.mesh is not msh for msh in gone)
                require(here, f"fields: {name!r} must be on the new mesh after build, a new one")
        for name, function in old.items():
            self._carry_field(function, new[name])

    def _carry_field(self, function: fem.Function, target: fem.Function) -> None:
        if target.function_space.mesh is function.function_space.mesh:
            target.x.array[:] = function.x.array
            return
        axisymmetric = self._remeshing.axisymmetric
        found = transfer(function, target.function_space, axisymmetric=axisymmetric)
        target.x.array[:] = found.x.array


def _both(before: _Balance, after: _Balance) -> tuple[Array, ...]:
    """Forces on the old and on the new mesh."""
    assert after.forces is not None
    unknown = [np.full_like(force, np.nan) for force in after.forces]
    pairs = zip(before.forces or unknown, after.forces, strict=True)
    return tuple(np.array(pair) for pair in pairs)


def _advise(report: RemeshingReport) -> None:
    if report.force_jump > JUMP:
        warnings.warn(
            f"remeshing: forces changed by {report.force_jump:.2%}, more than {JUMP:.1%}, due to "
            "the new mesh; ask for smaller cells where bodies touch",
            ContactWarning,
            stacklevel=2,
        )
