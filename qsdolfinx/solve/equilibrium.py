"""Equilibrium for given multipliers: bodies by Newton's method, driven tools in balance."""

from __future__ import annotations

from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.snes import NOT_BALANCED
from qsdolfinx.solve.tool_balance import ToolBalance


class Equilibrium:
    """Bodies and driven tools together.

    Args:
        newton: Solves for the bodies.
        balance: Moves the tools.
    """

    def __init__(self, newton: Newton, balance: ToolBalance) -> None:
        self.newton, self.balance = newton, balance

    def find(self) -> None:
        """Solve for the multipliers as they are. Collective.

        Raises:
            ConvergenceError: If a solve fails, or a tool's force cannot be balanced.
        """
        self.newton.solve()
        if self.balance.tools and not self.balance.find(self.newton):
            self.newton.fail(NOT_BALANCED)
