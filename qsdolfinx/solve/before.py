"""What was before a solve, to be put back when that is interrupted."""

from __future__ import annotations

from qsdolfinx.contact.state import ContactState
from qsdolfinx.system.system import ContactSystem
from qsdolfinx.tools.rigid_surface import as_tool


class Before:
    """Unknowns, tools and contacts as they are when this is made.

    Args:
        system: The system.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        self._unknowns = [u.x.array.copy() for u in system.u]
        tools = [tool for c in system.contacts if (tool := as_tool(c.master)) is not None]
        self._tools = [(tool, tool.state) for tool in tools]
        self._contacts = [ContactState(contact) for contact in system.contacts]

    def restore(self) -> None:
        """Put everything back. Collective."""
        for tool, state in self._tools:
            tool.restore(state)
        for contact in self._contacts:
            contact.restore()
        for u, unknowns in zip(self._system.u, self._unknowns, strict=True):
            u.x.array[:] = unknowns
        self._system.make_stale()  # penalties may be others than those it was made for
