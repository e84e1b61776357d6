"""Linear solvers of the system with condensed multipliers, the direct one too."""

import pytest

from qsdolfinx.solve.at_once import AtOnce


@pytest.fixture(autouse=True)
def condensed(monkeypatch):
    """Solves update multipliers around a penalty, whatever the solver."""
    monkeypatch.setattr(AtOnce, "fits", False)
