"""Initial positions of force-controlled rigid tools."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import motion
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.solve.first_guess import BALANCED
from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.surface.affine import Affine
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]


class Pressed(typing.NamedTuple):
    """Contact of a force-controlled tool, on one integration side.

    Attributes:
        contact: The contact.
        gap: The integration side.
        field: Displacement of the tool with s, its displacement along its direction.
        modulus: E of the slave, stress.
        with_friction: Whether it has friction.
    """

    contact: ContactModel
    gap: WeightedGap
    field: Affine
    modulus: float
    with_friction: bool

    @property
    def change(self) -> Array:
        """∂ḡ/∂s. Collective."""
        return self.gap.change(self.field)

    def held(self) -> float:
        """This rank's part of the contact force on the tool at the last evaluation."""
        pressure = self.gap.multiplier(self.contact.eps)
        return float(np.sum(self.gap.weight[:, None] * pressure * self.change))


class ToolBalance:
    """Move force-controlled tools into contact, and back if a solve fails.

    R_i = force_i − Σ ∂ḡ/∂s_i·S λ is the part of the force on tool i that contact pressure does not
    balance.

    Args:
        system: The system; its contacts store the motions of their tools.

    Raises:
        ValueError: If a force pulls a tool that has only unilateral contact without friction.
    """

    def __init__(self, system: ContactSystem) -> None:
        driven = [(tool, tool.driven) for tool in system.tools if tool.driven is not None]
        self.tools = [tool for tool, _ in driven]
        self._pressed = [
            [
                Pressed(contact, p, tool.driven_motion, modulus, bool(contact.slips))
                for contact, modulus in zip(system.contacts, system.moduli, strict=True)
                if contact.master is tool
                for p in contact.gaps
            ]
            for tool in self.tools
        ]
        self._force = np.array([by.force for _, by in driven])
        for (_, by), pressed in zip(driven, self._pressed, strict=True):
            if by.turns:
                continue
            holds = [p.contact.law.linear or p.with_friction for p in pressed]
            if by.force < 0 and not any(holds):
                raise ValueError("force: a negative one pulls the tool, which needs tied contact")
        self._start = [(tool.displacement.copy(), tool.rotation.copy()) for tool in self.tools]

    def restore(self) -> None:
        """Restore the initial motions. Collective."""
        for tool, start in zip(self.tools, self._start, strict=True):
            tool.displacement, tool.rotation = start
        self._tell()

    def _tell(self) -> None:
        for pressed in self._pressed:
            for p in pressed:
                motion.move_tool(p.contact)

    def _move(self, steps: Array) -> None:
        for tool, step in zip(self.tools, steps, strict=True):
            tool.move_driven((tool.displacement, tool.rotation), step)
        self._tell()

    def _sum(self, values: Array) -> Array:
        # Broadcast from one rank, so that all ranks take the same decisions.
        comm = self.tools[0].comm
        return np.asarray(comm.bcast(comm.reduce(values, op=MPI.SUM, root=0), root=0))

    def _imbalance(self) -> Array:
        """R at the last evaluation. Collective."""
        held = [sum(p.held() for p in pressed) for pressed in self._pressed]
        return np.asarray(self._force - self._sum(np.array(held)))

    # --- Touching

    def approach(self) -> None:
        """Move tools that hardly touch to their equilibrium on springs. Collective.

        Contacts must have been evaluated.
        """
        far = self._imbalance() / self._force > BALANCED
        steps = [self._settle(i) if far[i] else 0.0 for i in range(len(self.tools))]
        self._move(np.array(steps))

    def _settle(self, i: int) -> float:
        """Displacement of a tool to its equilibrium on springs; 0 if there is none. Collective."""
        springs = [
            Springs(p.gap, p.change.reshape(-1, 1), p.modulus or p.contact.eps, j)
            for j, p in enumerate(self._pressed[i])
        ]
        found = Foundation(springs, -self._force[i : i + 1]).settle()
        return 0.0 if found is None else float(found[0])
