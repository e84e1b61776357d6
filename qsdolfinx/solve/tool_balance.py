"""Rigid tools that are driven by a force: which displacement balances it."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.contact import Contact
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.solve.snes import ConvergenceError
from qsdolfinx.surface.affine import Affine
from qsdolfinx.system.blocks import Sides
from qsdolfinx.system.body import Body
from qsdolfinx.tools.rigid_surface import RigidSurface

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
        change: ∂ḡ/∂s, s being the tool's displacement along its direction.
        modulus: E of the slave, stress.
        slip: The pass's slip, None without friction.
        slip_change: ∂g/∂s.
    """

    contact: Contact
    body: int
    gap: WeightedGap
    change: Array
    modulus: float
    slip: Slip | None
    slip_change: Array

    def held(self) -> float:
        """This rank's part of the force that the tool is held with, at the last evaluation."""
        out = np.sum(self._weight * self.gap.multiplier(self.contact.eps) * self.change)
        if self.slip is not None:
            out += np.sum(self._weight * self.slip.response.traction * self.slip_change)
        return float(out)

    def multipliers(self, gap: Array, jump: Array) -> tuple[Array, Array]:
        """Changes of S λ and S τ with given changes of gap and jump."""
        change = self.contact.slope(self.gap)[:, None] * gap
        if self.slip is None:
            return self._weight * change, np.zeros_like(jump)
        response = self.slip.response
        friction = np.einsum("rij,rj->ri", response.stiffness, jump) + response.coupling * change
        return self._weight * change, self._weight * friction

    def changed(self, gap: Array, jump: Array) -> float:
        """This rank's part of the change of the force that the tool is held with."""
        normal, friction = self.multipliers(gap, jump)
        return float(np.sum(normal * self.change) + np.sum(friction * self.slip_change))

    @property
    def _weight(self) -> Array:
        return self.gap.weight[:, None]


class Drive:
    """Balance R_i(s) = force_i − Σ (∂ḡ/∂s_i·S λ + ∂g/∂s_i·S τ) = 0 of all driven tools i.

    The displacements s are no unknowns of the matrix. They are found by Newton's method around the
    solver: the derivative of the forces takes one solve with the factored tangent for each tool,
    which also says how the bodies follow. Force over displacement is convex in unilateral contact
    of linear bodies, so that this converges without any search once there is contact.

    Args:
        contacts: All contacts, paired and with a penalty, that know the motions of their tools.
        sides: Bodies of each contact.
        moduli: E of each contact, stress.

    Raises:
        ValueError: If a force pulls a tool that only unilateral contact without friction holds.
    """

    def __init__(
        self,
        contacts: typing.Sequence[Contact],
        sides: Sides,
        moduli: typing.Sequence[float],
    ) -> None:
        self.tools: list[RigidSurface] = []
        self._pressed: list[list[Pressed]] = []
        forces = []
        for contact, side, modulus in zip(contacts, sides, moduli, strict=True):
            tool = contact.master
            if not isinstance(tool, RigidSurface) or tool.driven is None:
                continue
            if not any(tool is known for known in self.tools):
                self.tools.append(tool)
                self._pressed.append([])
                forces.append(tool.driven.force)
            field = Affine(np.zeros((tool.gdim, tool.gdim)), tool.driven.direction)
            i = next(i for i, known in enumerate(self.tools) if known is tool)
            for j, p in enumerate(contact.passes):
                slip = contact.slips[j] if contact.slips else None
                none = np.zeros((len(p.values), tool.gdim))
                slip_change = none if slip is None else slip.tangential(slip.change(field))
                self._pressed[i].append(
                    Pressed(contact, side[0], p, p.change(field), modulus, slip, slip_change)
                )
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
                p.contact.move_tool()

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
        """Move tools that hardly touch to where springs would hold them (see Foundation).

        Collective; contacts must have been evaluated.
        """
        far = self._imbalance() / self._force > NEAR
        steps = [self._settle(i) if far[i] else 0.0 for i in range(len(self.tools))]
        self._move(np.array(steps))

    def _settle(self, i: int) -> float:
        """How far a tool moves until springs E/ℓ at the slave hold it, ℓ the size of the patch."""
        pressed = self._pressed[i]
        gap, change, weight = (
            np.concatenate(parts)
            for parts in zip(
                *(
                    (
                        p.gap.values.ravel(),
                        p.change.ravel(),
                        np.repeat(p.gap.weight, p.change.shape[1]),
                    )
                    for p in pressed
                ),
                strict=True,
            )
        )
        tied = np.concatenate([np.full(p.change.size, p.gap.law.linear) for p in pressed])
        E = max(p.modulus for p in pressed) or max(p.contact.eps for p in pressed)
        comm, area_dim = self.tools[i].comm, pressed[0].contact.slave.area_dim
        scale = comm.allreduce(np.max(np.abs(gap), initial=0.0), op=MPI.MAX)
        s, closed = 0.0, np.ones(len(gap), dtype=bool)
        for _ in range(3):
            area = float(self._sum(weight[closed].sum()))
            spring = E / area ** (1 / area_dim) if area > 0 else E
            for _ in range(_MAX_STEPS):
                g = gap + s * change
                closed = tied | (g >= -1e-12 * scale)
                pressure = spring * weight * np.where(closed, g, 0.0)
                stiffness = spring * weight * closed @ change**2
                force, stiffness = self._sum(np.array([pressure @ change, stiffness]))
                if stiffness > 0:
                    step = (self._force[i] - force) / stiffness
                else:
                    first = np.min(-g[change > 0] / change[change > 0], initial=np.inf)
                    step = comm.allreduce(first, op=MPI.MIN)
                    if not np.isfinite(step):
                        return 0.0
                s += float(step)
                if abs(force - self._force[i]) <= 1e-3 * abs(self._force[i]):
                    break
        return s

    # --- Balance

    def balance(
        self,
        bodies: typing.Sequence[Body],
        respond: typing.Callable[[Array], Array],
        follow: typing.Callable[[Array], None],
    ) -> bool:
        """Move the tools until the contact forces balance those that drive them. Collective.

        Args:
            bodies: All bodies, in equilibrium with the tools where they are.
            respond: From loads on the owned unknowns of all bodies to their change.
            follow: Changes the unknowns and brings the bodies into equilibrium again.

        Returns:
            Whether that was found.
        """
        for _ in range(_MAX_STEPS):
            R = self._imbalance()
            if np.all(np.abs(R) <= TOLERANCE * np.abs(self._force)):
                return True
            responses, J = self._tangent(bodies, respond)
            if np.any(np.diag(J) >= 0):  # a tool that touches nothing
                self.approach()
                follow(np.zeros(sum(body.num_owned for body in bodies)))
                continue
            self._try(np.asarray(np.linalg.solve(J, -R)), responses, follow)
        return False

    def _try(
        self, steps: Array, responses: list[Array], follow: typing.Callable[[Array], None]
    ) -> None:
        """Take Newton's step, or as much of it as the bodies can follow."""
        for attempt in range(_MAX_HALVINGS + 1):
            self._move(steps)
            try:
                follow(np.asarray(sum(s * y for s, y in zip(steps, responses, strict=True))))
                return
            except ConvergenceError:
                self._move(-steps)
                if attempt == _MAX_HALVINGS:
                    raise
                steps = steps / 2

    def _tangent(
        self, bodies: typing.Sequence[Body], respond: typing.Callable[[Array], Array]
    ) -> tuple[list[Array], Array]:
        """∂u/∂s_j of the owned unknowns, and ∂R_i/∂s_j. Collective."""
        responses = [respond(self._loads(i, bodies)) for i in range(len(self.tools))]
        J = np.zeros((len(self.tools), len(self.tools)))
        for j, response in enumerate(responses):
            parts = np.split(response, np.cumsum([body.num_owned for body in bodies])[:-1])
            vecs = [body.create_vec() for body in bodies]
            for vec, part in zip(vecs, parts, strict=True):
                vec.array[:] = part
            for i, pressed in enumerate(self._pressed):
                for p in pressed:
                    # Operators are applied on all ranks, whether they have rows or not.
                    gap = p.gap.operator.apply(vecs[p.body].handle, 0, p.gap.scale)
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
            p.gap.operator.add_transpose(-normal, vecs[p.body].handle, 0, False)
            if p.slip is not None:
                p.slip.operator.add_transpose(-friction, vecs[p.body].handle, 0, False)
        out = []
        for body, vec in zip(bodies, vecs, strict=True):
            load = np.zeros(body.num_owned)
            load[body.free] = vec.array_r[body.free]
            out.append(load)
            vec.destroy()
        return np.concatenate(out)
