"""Store the state before a solve, to restore it when the solve is interrupted."""

from __future__ import annotations

from qsdolfinx.contact.state import ContactState
from qsdolfinx.system.system import ContactSystem


class Before:
    """Copy of unknowns, tools and contacts at the time of creation.

    Args:
        system: The system.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        self._unknowns = [u.x.array.copy() for u in system.u]
        self._tools = [(tool, tool.state) for tool in system.tools]
        self._contacts = [ContactState(contact) for contact in system.contacts]

    def restore(self) -> None:
        """Restore everything. Collective."""
        for tool, state in self._tools:
            tool.restore(state)
        for contact in self._contacts:
            contact.restore()
        for u, unknowns in zip(self._system.u, self._unknowns, strict=True):
            u.x.array[:] = unknowns
        self._system.make_stale()  # penalties may differ from those of the matrix
