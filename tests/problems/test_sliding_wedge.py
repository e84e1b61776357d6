"""The sliding wedge, CGS-4: the demo against the closed form, and the demo's own results."""

import json
import sys

import numpy as np
import pytest
import sliding_wedge
from common.command import FORMULATIONS
from scenes import WORLD
from sliding_wedge import Parameters, build, closed_form, run


def test_closed_form_values():
    """The closed form gives the values of the benchmark."""
    values = [closed_form(mu) for mu in (0, 0.1, 0.2, 0.3)]
    np.testing.assert_allclose(values, [0.1, 0.202020, 0.306122, 0.412371], atol=5e-7)


MADE = [(f, "penalty") for f in FORMULATIONS]
MADE += [(f, "augmented-lagrangian") for f in FORMULATIONS if f != "double-pass"]


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize(("formulation", "enforcement"), MADE)
def test_full_slip(formulation, quadrature, enforcement):
    """The force ratio is right to rounding errors, and the incline carries all of the load."""
    for mu in (0.0, 0.1, 0.2, 0.3) if enforcement == "penalty" else (0.0, 0.3):
        p = Parameters(mu, formulation, quadrature, enforcement)
        result, table, _ = run(p)
        last = table[-1]
        assert result["ratio_error"] < 1e-9
        assert last["slipping"] == last["active"] > 0
        assert abs(last["carried"] - 1) < 1e-10
        assert abs(last["contact_ratio"] - last["ratio"]) < 1e-10


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_stick_before_slip(quadrature):
    """Under small pushes the force grows from step to step while more and more nodes slip."""
    _, table, _ = run(Parameters(mu=0.5, quadrature=quadrature, push=1e-4))
    ratio = np.array([row["ratio"] for row in table])
    share = np.array([row["slipping"] / row["active"] for row in table])
    part = share < 1
    assert part.sum() >= 3 and not part[-1]
    assert np.all(np.diff(ratio) > -1e-12)
    assert np.all(ratio[part] < closed_form(0.5) - 1e-6)
    assert np.allclose(ratio[~part][1:], closed_form(0.5), rtol=1e-10)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_travel(formulation):
    """Over several facets, with updated contact, the force ratio is nearly the same.

    The surfaces are deformed.
    """
    result, table, _ = run(Parameters(mu=0.3, formulation=formulation, travel=0.5))
    assert np.isclose(table[-1]["shift"], 0.5)
    assert 1e-9 < result["ratio_error"] < 1e-3


def test_other_mu():
    for mu in (0.05, 0.5):
        assert run(Parameters(mu=mu))[0]["ratio_error"] < 1e-10


def test_no_friction_without_mu():
    """A wedge without friction has no tangential constraints; a negative μ is refused."""
    contact = build(WORLD, Parameters(mu=0.0))[1]
    assert contact.friction is None and contact.model.slips == () and contact.model.symmetric
    with pytest.raises(ValueError, match="mu"):
        build(WORLD, Parameters(mu=-0.1))


def test_command(monkeypatch, tmp_path, capsys):
    """--json writes one key."""
    filename = WORLD.bcast(str(tmp_path / "wedge.json"))
    arguments = ["sliding_wedge.py", "--mu", "0.1", "--json", filename]
    monkeypatch.setattr(sys, "argv", arguments)
    sliding_wedge.main()
    WORLD.barrier()
    with open(filename) as file:
        result = json.load(file)
    assert list(result) == ["ratio_error"] and result["ratio_error"] < 1e-10
    printed = capsys.readouterr().out
    assert WORLD.rank > 0 or "closed form 0.20202020" in printed
