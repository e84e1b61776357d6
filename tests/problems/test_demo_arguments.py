"""Arguments that the demos refuse before they start to compute."""

import importlib
import sys

import pytest
from common import pictures

DEMOS = (
    "block_on_block",
    "cattaneo_mindlin",
    "curved_beams",
    "fold",
    "rubber",
    "forging",
    "hertz",
    "ironing",
    "patch_test",
    "ring_compression",
    "shaft",
    "sliding_wedge",
    "upset_cylinder",
    "upsetting_convergence",
)


def refused(monkeypatch, capsys, name, *arguments):
    """Error message of a demo that refuses its arguments."""
    demo = importlib.import_module(name)

    def run(*args, **kwargs):
        raise AssertionError("has started to compute")

    monkeypatch.setattr(demo, "run", run)
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    with pytest.raises(SystemExit) as stopped:
        demo.main()
    assert stopped.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize("name", DEMOS)
def test_missing_folder(monkeypatch, capsys, tmp_path, name):
    """A missing folder is an error at once, not after hours of computing."""
    missing = str(tmp_path / "none" / "result.json")
    assert "--json: there is no folder" in refused(monkeypatch, capsys, name, "--json", missing)
    assert "or" in refused(monkeypatch, capsys, name, "--json", str(tmp_path))


def test_ring_table_has_its_own_friction(monkeypatch, capsys):
    for more in (["--friction", "coulomb"], ["--m-bar", "0.2"]):
        said = refused(monkeypatch, capsys, "ring_compression", "--table", *more)
        assert more[0] in said


def test_ironing_writes_output_beside_the_picture(monkeypatch, tmp_path):
    """--plot alone draws three runs of its own; --output causes one more run."""
    import ironing

    drawn, ran = [], []
    monkeypatch.setattr(pictures, "ironing", lambda filename, *how: drawn.append(filename))
    monkeypatch.setattr(ironing, "run", lambda p: ran.append(p.output) or ({"steps": 1},))
    picture, output = str(tmp_path / "a.png"), str(tmp_path / "out")
    for more, expected in (([], []), (["--output", output], [output])):
        monkeypatch.setattr(sys, "argv", ["ironing", "--plot", picture, *more])
        ironing.main()
        assert ran == expected
    assert drawn == [picture, picture]


@pytest.mark.parametrize("name", ("block_on_block", "forging", "hertz", "patch_test"))
def test_double_pass_has_no_multipliers(monkeypatch, capsys, name):
    options = ["--formulation", "double-pass", "--enforcement", "augmented-lagrangian"]
    assert "--enforcement: " in refused(monkeypatch, capsys, name, *options)
