"""Rigid tools that a force drives: which displacement balances it."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set, motion
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.snes import ConvergenceError
from qsdolfinx.surface.affine import Affine
from qsdolfinx.system.body import Body
from qsdolfinx.system.system import ContactSystem
from qsdolfinx.tools.rigid_surface import RigidSurface, as_tool

Array = npt.NDArray[np.float64]

#: Part of the driving force that may be left unbalanced.
TOLERANCE = 1e-8

#: Tools are brought to touch first if contact leaves more than this part of the force to be held.
NEAR = 0.5

_MAX_STEPS = 30
_MAX_HALVINGS = 6


class Pressed(typing.NamedTuple):
    """What a driven tool presses on in one pass of a contact.

    Attributes:
        contact: The contact.
        body: Index of the slave's body.
        gap: The pass.
        field: Displacement of the tool with s, its displacement along its direction.
        modulus: E of the slave, stress.
        slip: The pass's slip, None without friction.
        known: ∂ḡ/∂s and ∂g/∂s; None where gaps follow the bodies, whose derivatives change.
    """

    contact: ContactModel
    body: int
    gap: WeightedGap
    field: Affine
    modulus: float
    slip: Slip | None
    known: tuple[Array, Array] | None

    @classmethod
    def of(
        cls,
        contact: ContactModel,
        body: int,
        gap: WeightedGap,
        field: Affine,
        modulus: float,
        slip: Slip | None,
    ) -> Pressed:
        """With what stays of it. Collective."""
        out = cls(contact, body, gap, field, modulus, slip, None)
        if gap.following is not None:
            return out
        return out._replace(known=(out.change, out.slip_change))

    @property
    def change(self) -> Array:
        """∂ḡ/∂s. Collective."""
        return self.gap.change(self.field) if self.known is None else self.known[0]

    @property
    def slip_change(self) -> Array:
        """∂g/∂s. Collective."""
        if self.known is not None:
            return self.known[1]
        if self.slip is None:
            return np.zeros((self.gap.num_rows, len(self.field.b)))
        return self.slip.tangential(self.slip.change(self.field))

    def held(self) -> float:
        """This rank's part of the force that the tool is held with, at the last evaluation."""
        out = np.sum(self._weight * self.gap.multiplier(self.contact.eps) * self.change)
        if self.slip is not None:
            traction = self.slip.state.response.traction
            out += np.sum(self.slip.weight[:, None] * traction * self.slip_change)
        return float(out)

    def multipliers(self, gap: Array, jump: Array) -> tuple[Array, Array]:
        """Changes of S λ and S τ with given changes of gap and jump."""
        change = active_set.slope(self.contact, self.gap)[:, None] * gap
        if self.slip is None:
            return self._weight * change, np.zeros_like(jump)
        response = self.slip.state.response
        at_nodes = self.slip.at_nodes(change)
        friction = np.einsum("rij,rj->ri", response.stiffness, jump) + response.coupling * at_nodes
        return self._weight * change, self.slip.weight[:, None] * friction

    def changed(self, gap: Array, jump: Array) -> float:
        """This rank's part of the change of the force that the tool is held with."""
        normal, friction = self.multipliers(gap, jump)
        return float(np.sum(normal * self.change) + np.sum(friction * self.slip_change))

    @property
    def _weight(self) -> Array:
        return self.gap.weight[:, None]


class ToolBalance:
    """Balance R_i(s) = force_i − Σ (∂ḡ/∂s_i·S λ + ∂g/∂s_i·S τ) = 0 of all driven tools i.

    The displacements s are no unknowns of the matrix. They are found by Newton's method around the
    solver: the derivative of the forces takes one solve with the factored tangent for each tool,
    which also says how the bodies follow. Force over displacement is convex in unilateral contact
    of linear bodies, so that this converges without any search once there is contact.

    Args:
        system: The system, whose contacts know the motions of their tools.

    Raises:
        ValueError: If a force pulls a tool that only unilateral contact without friction holds.
    """

    def __init__(self, system: ContactSystem) -> None:
        self.tools: list[RigidSurface] = []
        self._pressed: list[list[Pressed]] = []
        forces = []
        parts = zip(system.contacts, system.sides, system.moduli, strict=True)
        for contact, side, modulus in parts:
            tool = as_tool(contact.master)
            if tool is None or tool.driven is None:
                continue
            if not any(tool is known for known in self.tools):
                self.tools.append(tool)
                self._pressed.append([])
                forces.append(tool.driven.force)
            field = Affine(np.zeros((tool.gdim, tool.gdim)), tool.driven.direction)
            i = next(i for i, known in enumerate(self.tools) if known is tool)
            for j, p in enumerate(contact.gaps):
                slip = contact.slips[j] if contact.slips else None
                self._pressed[i].append(Pressed.of(contact, side[0], p, field, modulus, slip))
        self._force = np.array(forces)
        for force, pressed in zip(forces, self._pressed, strict=True):
            holds = [p.contact.law.linear or p.slip is not None for p in pressed]
            if force < 0 and not any(holds):
                raise ValueError("force: a negative one pulls the tool, which needs tied contact")
        self._start = [tool.displacement.copy() for tool in self.tools]

    def restore(self) -> None:
        """Put the displacements back that were there at first. Collective."""
        for tool, displacement in zip(self.tools, self._start, strict=True):
            tool.displacement = displacement
        self._tell()

    def _tell(self) -> None:
        for pressed in self._pressed:
            for p in pressed:
                motion.move_tool(p.contact)

    def _move(self, steps: Array) -> None:
        for tool, step in zip(self.tools, steps, strict=True):
            assert tool.driven is not None
            tool.displacement = tool.displacement + step * tool.driven.direction
        self._tell()

    def _sum(self, values: Array) -> Array:
        # From one rank to all, so that all take the same decisions.
        comm = self.tools[0].comm
        return np.asarray(comm.bcast(comm.reduce(values, op=MPI.SUM, root=0), root=0))

    def _imbalance(self) -> Array:
        """R at the last evaluation. Collective."""
        held = [sum(p.held() for p in pressed) for pressed in self._pressed]
        return np.asarray(self._force - self._sum(np.array(held)))

    # --- Touching

    def approach(self) -> None:
        """Move tools that hardly touch to where springs would hold them. Collective.

        Contacts must have been evaluated.
        """
        far = self._imbalance() / self._force > NEAR
        steps = [self._settle(i) if far[i] else 0.0 for i in range(len(self.tools))]
        self._move(np.array(steps))

    def _settle(self, i: int) -> float:
        """How far a tool moves until springs hold it; 0 if none ever do. Collective."""
        springs = [
            Springs(p.gap, p.change.reshape(-1, 1), p.modulus or p.contact.eps, j)
            for j, p in enumerate(self._pressed[i])
        ]
        found = Foundation(springs, -self._force[i : i + 1]).settle()
        return 0.0 if found is None else float(found[0])

    # --- Balance

    def find(self, newton: Newton) -> bool:
        """Move the tools until the contact forces balance those that drive them. Collective.

        Args:
            newton: Solves for the bodies, which are in equilibrium with the tools where they are.

        Returns:
            Whether that was found.
        """
        for _ in range(_MAX_STEPS):
            R = self._imbalance()
            if np.all(np.abs(R) <= TOLERANCE * np.abs(self._force)):
                return True
            responses, J = self._tangent(newton)
            if np.any(np.diag(J) >= 0):  # a tool that touches nothing
                self.approach()
                newton.follow(np.zeros(len(newton.system.x.array_r)))
                continue
            self._try(np.asarray(np.linalg.solve(J, -R)), responses, newton)
        return False

    def _try(self, steps: Array, responses: list[Array], newton: Newton) -> None:
        """Take Newton's step, or as much of it as the bodies can follow."""
        for attempt in range(_MAX_HALVINGS + 1):
            self._move(steps)
            try:
                newton.follow(np.asarray(sum(s * y for s, y in zip(steps, responses, strict=True))))
                return
            except ConvergenceError:
                self._move(-steps)
                if attempt == _MAX_HALVINGS:
                    raise
                steps = steps / 2

    def _tangent(self, newton: Newton) -> tuple[list[Array], Array]:
        """∂u/∂s_j of the owned unknowns, and ∂R_i/∂s_j. Collective."""
        system, bodies = newton.system, newton.system.bodies
        responses = [newton.respond(self._loads(i, bodies)) for i in range(len(self.tools))]
        J = np.zeros((len(self.tools), len(self.tools)))
        for j, response in enumerate(responses):
            vecs = [body.create_vec() for body in bodies]
            for vec, part in zip(vecs, system.parts(response), strict=True):
                vec.array[:] = part
            for i, pressed in enumerate(self._pressed):
                for p in pressed:
                    # Operators are applied on all ranks, whether they have rows or not.
                    gap = p.gap.operator.apply(vecs[p.body].handle, 0, p.gap.state.scale)
                    jump = p.slip_change * 0.0
                    if p.slip is not None:
                        jump = p.slip.tangential(p.slip.jump_of((vecs[p.body], None)))
                    if i == j:
                        gap, jump = gap + p.change, jump + p.slip_change
                    J[i, j] -= p.changed(gap, jump)
            for vec in vecs:
                vec.destroy()
        return responses, self._sum(J)

    def _loads(self, i: int, bodies: typing.Sequence[Body]) -> Array:
        """−∂r/∂s_i, r the residual of all bodies, zero at Dirichlet conditions. Collective."""
        vecs = [body.create_vec() for body in bodies]
        for p in self._pressed[i]:
            normal, friction = p.multipliers(p.change, p.slip_change)
            p.gap.operator.add_transpose(-normal, vecs[p.body].handle, 0)
            if p.slip is not None:
                p.slip.operator.add_transpose(-friction, vecs[p.body].handle, 0)
        out = []
        for body, vec in zip(bodies, vecs, strict=True):
            load = np.zeros(body.num_owned)
            load[body.free] = vec.array_r[body.free]
            out.append(load)
            vec.destroy()
        return np.concatenate(out)
