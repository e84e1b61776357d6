"""When contact pairs are updated again in a step: by how much bodies may slide or turn."""

import types

import numpy as np
import pytest

from qsdolfinx.steps import pairings
from qsdolfinx.steps.pairings import Pairings


def again(monkeypatch, slides=0.0, turns=0.0, tie=0.0, flows=False):
    """Whether pairs are updated again after such motions of one contact on a tool."""
    monkeypatch.setattr(pairings, "slid", lambda *_: slides)
    monkeypatch.setattr(pairings, "turned", lambda *_: turns)
    monkeypatch.setattr(pairings, "turning_error", lambda *_: tie)
    model = types.SimpleNamespace(follows=False, has_gaps=tie == 0.0)
    contact = types.SimpleNamespace(model=model)
    body = np.zeros(3)
    inside = {
        "_motions": [],
        "_tools": [],
        "_way": lambda tool: None,
        "_now": lambda: [body],
        "_paired": [body],
        "_sides": lambda: [(contact, (0, None), None)],
        "_in_velocity": [flows],
    }
    return Pairings.have_slid(types.SimpleNamespace(**inside))


@pytest.mark.parametrize("facets, flows, expected", (
    (0.02, False, False), (0.2, False, True), (0.2, True, False), (0.9, True, True),
))  # fmt: skip
def test_sliding(monkeypatch, facets, flows, expected):
    """A small part of a facet changes forces; bodies that flow may slide by more."""
    assert again(monkeypatch, slides=facets, flows=flows) == expected


@pytest.mark.parametrize("angle, expected", ((0.005, False), (0.1, True)))
def test_rotation(monkeypatch, angle, expected):
    """Directions of forces may be wrong by some per cent."""
    assert again(monkeypatch, turns=angle) == expected


@pytest.mark.parametrize("error, expected", ((0.002, False), (0.05, True)))
def test_ties(monkeypatch, error, expected):
    assert again(monkeypatch, tie=error) == expected
