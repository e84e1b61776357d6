"""Find steps that jump to a distant equilibrium (snap-through), by the energy that they release."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact import results
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.shown import shown
from qsdolfinx.gap.laws import Tied, Unilateral
from qsdolfinx.surface.affine import rotation_vector
from qsdolfinx.system.system import ContactSystem
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]

#: Change of the bodies' displacements from the first Newton iterate to the solution, over their
#: change in the step, below which nothing is evaluated: Newton's first step then predicts the
#: motion. Across unstable states it misses almost all of it.
CORRECTED = 0.5

#: Released energy above which a step warns, over the work in the step. The bound is negative on
#: stable paths, and small if the load grows by half in the step that jumps.
OF_WORK = 0.02

#: Released energy above which a step warns, over the stored energy, and energy that nothing has
#: supplied. Where bodies slide over several facets in a step, forces change to and fro in it, and a
#: part of the work seems to be released.
OF_STORED = 0.06

#: Released energy over the stored energy, above which a step warns where more is released than the
#: whole work in the step, which changes of forces to and fro do not explain. In large rigid turns
#: without work a thousandth may seem to be released.
OF_STORED_BEYOND = 0.003

#: Weights of the rule of Boole at 0, 1/4, ..., 1, and those of Simpson for its error.
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90
SIMPSON = np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6

#: Number of states at which forces are evaluated, from the start to the end of a step.
PARTS = np.linspace(0.0, 1.0, len(BOOLE))


class Missed(typing.NamedTuple):
    """Difference of a solution and the first Newton iterate that satisfies all conditions.

    Attributes:
        part: Norm of the bodies' part of it, over that of their motion in the step.
        bodies: Unknowns of the bodies, owned by this rank.
        tools: Displacement or angle of each force-controlled tool.
    """

    part: float
    bodies: Array
    tools: dict[RigidSurface, float]

    @classmethod
    def nothing(cls) -> Missed:
        """No difference."""
        return cls(0.0, np.zeros(0), {})


class OfTool(typing.NamedTuple):
    """Position of a rigid tool, and the contact forces on it.

    Attributes:
        pose: Its position at the end of its motion.
        center: Its centre there.
        force: Force of all contacts on it, (gdim,).
        moment: Their moment about the centre, (3,) or (1,).
    """

    pose: Pose
    center: Array
    force: Array
    moment: Array


class Equilibrium(typing.NamedTuple):
    """State of all bodies and tools in equilibrium.

    Attributes:
        unknowns: Owned unknowns of each body.
        forces: F of each body, owned unknowns.
        reactions: Forces of Dirichlet conditions on each body, owned constrained unknowns.
        tools: The rigid tools.
        gaps: Energy stored in gaps.
    """

    unknowns: list[Array]
    forces: list[Array]
    reactions: list[Array]
    tools: dict[RigidSurface, OfTool]
    gaps: float

    @classmethod
    def of(cls, system: ContactSystem) -> Equilibrium:
        """The present state. Collective."""
        bodies, stored = system.bodies, 0.0
        unknowns = [body.u.x.array[: body.num_owned].copy() for body in bodies]
        forces = [body.forces_at(x) for body, x in zip(bodies, unknowns, strict=True)]
        sums = [force.copy() for force in forces]
        tools = dict[RigidSurface, OfTool]()
        for contact, sides in zip(system.contacts, system.sides, strict=True):
            model = shown(contact)
            for i, on_body in zip(sides, results.forces_on_bodies(model), strict=False):
                if i is not None:
                    sums[i] += on_body
            stored += results.energy(model)
            for tool in contact.master.tools:
                found = _tool_of(tool, model)
                if tool in tools:  # of another contact
                    force = found.force + tools[tool].force
                    found = found._replace(force=force, moment=found.moment + tools[tool].moment)
                tools[tool] = found
        pairs = zip(bodies, sums, strict=True)
        return cls(unknowns, forces, [f[b.owned_constrained] for b, f in pairs], tools, stored)


def _tool_of(tool: RigidSurface, model: ContactModel) -> OfTool:
    """Position of a tool after its motion, and the forces of a contact on it. Collective."""
    pose = Pose.from_matrix(tool.state.pose.moved(tool.motion), tool.gdim)
    center = tool.center_at(pose.matrix)
    force, moment = results.total(model, "master"), results.moment(model, "master", center)
    return OfTool(pose, center, force, moment)


class Work(typing.NamedTuple):
    """Work of a force in a step.

    Attributes:
        begun: With the force at the start of the step.
        ended: With the force at its end.
        short: With the force at its end, on what the first Newton iterate lacked of the motion, if
            the force is prescribed; otherwise 0.
    """

    begun: float
    ended: float
    short: float

    @property
    def least(self) -> float:
        """Lower bound."""
        is_concave = self.short > CORRECTED * self.ended > 0
        return 0.5 * (self.begun + self.ended) if is_concave else min(self.begun, self.ended)

    @property
    def most(self) -> float:
        """Upper bound."""
        return max(self.begun, self.ended)


class Released(typing.NamedTuple):
    """Energy that a step has released, or gained.

    Attributes:
        least: Lower bound of the released energy.
        gained: Lower bound of the energy that nothing has supplied.
        work: Work of loads, Dirichlet conditions and tools in the step: sum of the magnitudes of
            all its parts.
        supplied: Upper bound of the positive parts of this work.
        stored: Energy stored in the bodies, of the size of that of linear ones.
        error: Estimated error of the energy stored in the step.
    """

    least: float
    gained: float
    work: float
    supplied: float
    stored: float
    error: float

    @property
    def is_notable(self) -> bool:
        """Whether the released energy is a notable part of the work and of the stored energy."""
        part = OF_STORED if self.least <= self.work else OF_STORED_BEYOND
        return bool(self.least > max(OF_WORK * self.work, part * self.stored, self.error))

    @property
    def is_from_nowhere(self) -> bool:
        """Whether more energy is gained than was supplied, and a notable part of the stored one."""
        return bool(self.gained > max(self.supplied, OF_STORED * self.stored, self.error))


class Jump(typing.NamedTuple):
    """Jump to a distant equilibrium.

    Attributes:
        text: Warning about it.
        is_wrong: Whether no motion leads to this equilibrium, since it has gained energy.
    """

    text: str
    is_wrong: bool


class SnapThrough:
    """Check whether a step has jumped to a distant equilibrium, and how much energy it released.

    Let u_0 and u_1 be the unknowns of the bodies at the start and at the end of a step, which are
    both in equilibrium, and D = u_1 − u_0. F = N − f contains the internal forces N and the loads
    f. A quasi-static motion between the two states, slow enough for the forces to remain in
    balance, satisfies

        W = ΔE + ΔΦ + Q,   ΔE = ∫_0^1 N(u_0 + s D)·D ds,   W = ∫ (f·du + q·du + P·dx).

    E is the energy of the bodies: ΔE does not depend on the path, so that the straight one is
    taken. Φ is the energy of the contacts (of penalties, ties, laws), and Q ≥ 0 the energy that
    friction dissipates. W is the work of the loads f, of the forces q of the Dirichlet conditions,
    and of the forces P and moments of the rigid tools. Contact forces between bodies do no other
    work. At both ends of the step f, q and P are known. If each of them changes monotonically in
    the step, W is at least

        W_min = min(f_0·D, f_1·D) + min(q_0·D, q_1·D) + min(P_0·Δx, P_1·Δx),

    so that at least W_min − ΔE − ΔΦ − Q has become kinetic energy, or heat, in a motion that is not
    quasi-static. Q counts twice in this bound: where contact moves over several facets in a step, a
    part of the energy that friction dissipates is not known. At a limit point the bound is the area
    between the constant load and the curve of the equilibria: large, however small the step. In
    steps on a stable path it is negative, since forces and motions grow together. Likewise, with
    W_max of the larger works, at least ΔE + ΔΦ + Q − W_max has been gained from nothing: Newton's
    method has found an equilibrium of another branch, which no motion leads to.

    This is evaluated only if the first Newton iterate that satisfies all conditions, which is the
    linear prediction from the start of the step, has missed the end of the step by
    :data:`CORRECTED` of the motion. If it falls short by as much in the work of a prescribed force
    (a load, or the force on a tool), force over motion is a concave curve, above its chord: the
    least work is then ½ (f_0 + f_1)·D, which makes the bound useful in coarse steps.

    A step is not checked if bodies are velocity-based, have unknowns of several kinds (such as
    pressures) or conduct heat; if contacts have laws of the user; if all is linear; or if the state
    at its start is not that of a solve of this problem, such as after a remeshing or a restart.

    Args:
        system: The system.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        self._last: Equilibrium | None = None

    @property
    def applies(self) -> bool:
        """Whether energies decide: displacements alone, and something nonlinear."""
        system = self._system
        if system.linear or "velocity" in system.unknowns:
            return False
        if any(type(contact.law) not in (Unilateral, Tied) for contact in system.contacts):
            return False
        return all(len(body.groups) == 1 for body in system.bodies)

    def accept(self) -> None:
        """Store the present equilibrium as the start of the next step. Collective."""
        self._last = Equilibrium.of(self._system) if self.applies else None

    def find(self, start: typing.Sequence[Array], missed: Missed) -> Jump | None:
        """A jump since the last equilibrium, or None. Collective.

        Unknowns, multipliers and contacts are as before.

        Args:
            start: Unknowns of the bodies at the start of the step, ghosts included.
            missed: What Newton's first iterate lacked.
        """
        released = self.released(start, missed) if missed.part > CORRECTED else None
        if released is None:
            return None
        if released.is_from_nowhere:
            text = (
                "snap-through: this equilibrium stores more energy than the last one, by "
                f"{released.gained:.2g} more than loads, conditions and tools can have supplied "
                f"(at most {released.supplied:.2g}): no motion leads there, and forces may be "
                "those of another branch; go back, and take smaller steps"
            )
            return Jump(text, True)
        if not released.is_notable:
            return None
        part = released.least / released.work if released.work > 0 else np.inf
        text = (
            "snap-through: this equilibrium is far from the last one, and the states in between "
            f"are unstable. At least {released.least:.2g} of energy was released, {part:.2g} times "
            "the work in the step; a quasi-static step cannot follow this motion, and other "
            "equilibria may exist. To follow the unstable path, drive tools or bodies by "
            "displacements instead of forces; for the motion itself, add inertia or viscous "
            "damping to F. Smaller steps show where the jump begins, but do not avoid it. Sharp "
            "corners that slide jump like this from node to node: round them"
        )
        return Jump(text, False)

    def released(self, start: typing.Sequence[Array], missed: Missed) -> Released | None:
        """Energy released since the last equilibrium; None if it is not known. Collective.

        Arguments as for :meth:`find`.
        """
        last, system = self._last, self._system
        if last is None or not self.applies or not self._is_at(last.unknowns, start):
            return None
        now = Equilibrium.of(system)
        # For each body: ∫ F·D ds and its error, work of loads and conditions at both ends, N·u.
        lacking = missed.bodies if missed.part > 0 else np.zeros_like(system.x.array_r)
        short = enumerate(system.parts(lacking))
        sums = np.array([self._sums(i, last, now, part) for i, part in short])
        system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        if not np.isfinite(sums).all():
            return None
        friction = sum(results.step_dissipation(shown(contact)) for contact in system.contacts)
        taken = float(np.sum(sums[:, 0])) + now.gaps - last.gaps + friction
        works = [Work(float(of[4]), float(of[5]), 0.0) for of in sums]
        works += [Work(float(of[2]), float(of[3]), float(of[8])) for of in sums]
        for tool, end in now.tools.items():
            if tool not in last.tools:
                return None
            works += _works(last.tools[tool], end, tool, missed.tools.get(tool, 0.0))
        least = sum(each.least for each in works) - taken - friction
        gained = taken - sum(each.most for each in works)
        work = sum(max(abs(each.begun), abs(each.ended)) for each in works)
        supplied = sum(max(each.most, 0.0) for each in works)
        error = float(np.sum(np.abs(sums[:, 1])))
        stored = 0.5 * float(np.sum(np.max(np.abs(sums[:, 6:8]), axis=1)))
        return Released(least, gained, work, supplied, stored, error)

    def _is_at(self, unknowns: typing.Sequence[Array], start: typing.Sequence[Array]) -> bool:
        """Whether a step has started from these unknowns. Collective."""
        pairs = zip(unknowns, start, strict=True)
        same = all(np.array_equal(x, array[: len(x)]) for x, array in pairs)
        return bool(self._system.comm.allreduce(same, op=MPI.LAND))

    def _sums(self, i: int, last: Equilibrium, now: Equilibrium, short: Array) -> list[float]:
        """This rank's part of the energy and works of a body. Collective.

        Returns:
            ΔE and its error, f_0·D, f_1·D, q_0·D, q_1·D, N·u at both ends, and the work of f_1 on
            what the first iterate lacked.
        """
        body, x0, x1 = self._system.bodies[i], last.unknowns[i], now.unknowns[i]
        D, held = x1 - x0, body.owned_constrained
        loads = -body.forces_at(np.zeros_like(x1))  # N = 0 in the undeformed state
        parts = PARTS if not body.linear else PARTS[[0, -1]]
        begun, *inner = (body.forces_at(x0 + s * D) for s in parts[:-1])
        along = [begun, *inner, now.forces[i]]
        powers = np.array([float((F + loads) @ D) for F in along])
        energy = 0.5 * float(np.sum(powers)) if body.linear else float(BOOLE @ powers)
        error = 0.0 if body.linear else energy - float(SIMPSON @ powers)
        of_loads = float(loads @ D)
        return [
            energy,
            error,
            of_loads - float((last.forces[i] - begun) @ D),
            of_loads,
            float(last.reactions[i] @ D[held]),
            float(now.reactions[i] @ D[held]),
            float((begun + loads) @ x0),
            float((now.forces[i] + loads) @ x1),
            float(loads @ short),
        ]


def _works(last: OfTool, now: OfTool, tool: RigidSurface, short: float) -> list[Work]:
    """Work of a tool on the bodies by its translation and by its rotation.

    Args:
        last: The tool at the start of the step.
        now: The tool at its end.
        tool: The tool.
        short: Displacement or angle that the first iterate lacked; 0 if no force drives it.
    """
    way = now.center - last.center
    turn = rotation_vector(now.pose.R @ last.pose.R.T)
    driven = tool.driven
    lacking = 0.0 if driven is None else driven.force * short
    by_moment = driven is not None and driven.turns
    return [
        Work(-float(last.force @ way), -float(now.force @ way), 0.0 if by_moment else lacking),
        Work(-float(last.moment @ turn), -float(now.moment @ turn), lacking if by_moment else 0.0),
    ]


def check_snap_through(
    check: SnapThrough, start: typing.Sequence[Array] | None, missed: Missed
) -> Jump | None:
    """Find a jump to a distant equilibrium, and warn on all ranks if it is possible. Collective.

    Args:
        check: The check of the problem.
        start: Unknowns of the bodies at the start of the step; None if they are not known.
        missed: As for :meth:`SnapThrough.find`.

    Returns:
        The jump, or None. There is no warning about it if no motion leads there.
    """
    found = None if start is None else check.find(start, missed)
    if found is not None and not found.is_wrong:
        warn(found.text, ContactWarning)
    return found
