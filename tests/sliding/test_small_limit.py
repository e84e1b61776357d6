"""For vanishing displacements finite sliding is the same as small sliding."""

import numpy as np
import pytest
from following import Boxes
from scenes import largest

import qsdolfinx as qs
from qsdolfinx.contact import penalty

KINDS = {
    "augmented": {},
    "penalty": {"enforcement": "penalty", "penalty": 1e3},
    "master-slave": {"formulation": "master-slave"},
    "double-pass": {"formulation": "double-pass"},
    "friction": {"friction": qs.Coulomb(0.3)},
    "second-degree": {"degree": 2},
    "tetrahedron": {"cell": "tetrahedron"},
    "swapped": {"swap": True},
}


def solve(size, sliding, cell="quadrilateral", degree=1, swap=False, **options):
    across = () if cell == "quadrilateral" else (1.0,)
    n = [(*[3] * len(across), 3), (*[2] * len(across), 3)]
    scene = Boxes(
        cell,
        ((8, *n[0]), (5, *n[1])),
        ((2.4, *across, 1.0), (1.0, *across, 1.0)),
        start=0.73,
        degree=degree,
    )
    top = scene.clamp_far()
    top.value[0], top.value[-1] = 0.3 * size, -size
    surfaces = scene.above, scene.below
    contact = qs.Contact(
        *(surfaces[::-1] if swap else surfaces),
        normals="facet",
        sliding=sliding,
        constraints="points",
        **options,
    )
    scene.problem(contact, solver="direct").solve()
    return scene


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_second_order(options, monkeypatch):
    """Halving the displacements divides the differences by four."""
    # The part of a gap within a facet that multipliers cannot represent is resisted by γ.
    monkeypatch.setattr("qsdolfinx.contact.penalty.FOLLOWING_FACTOR", penalty.POINTS_FACTOR)
    differences = []
    for size in (0.008, 0.004):
        found, limit = (solve(size, sliding, **options) for sliding in ("finite", "small"))
        differences.append(
            largest(
                *(
                    a.u.x.array - b.u.x.array
                    for a, b in zip(found.bodies, limit.bodies, strict=True)
                )
            )
        )
    assert differences[0] < 2 * 0.008**2
    assert 3.0 < differences[0] / differences[1] < 5.0 or np.max(differences) < 1e-9
