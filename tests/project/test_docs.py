"""README and docs: code prints the text of the pages, commands parse, and links have targets."""

import argparse
import contextlib
import functools
import io
import re
import runpy
import sys

import numpy as np
import pytest
from project import pages

import qsdolfinx as qs

PAGES = {str(page.relative_to(pages.ROOT)): page for page in pages.pages()}
PROGRAMS = {
    str(path.relative_to(pages.ROOT)): path
    for folder in ("demos", "demos/engineering", "bench", "tests/hard", "tests/fuzz")
    for path in sorted((pages.ROOT / folder).glob("*.py"))
    if re.search("parse_args|Command", path.read_text(encoding="utf-8"))
}
PROGRAM = re.compile(r"(demos|bench|tests)/(\w+/)*(?!test_)\w+\.py")
run = functools.cache(pages.run)


@pytest.mark.parametrize("name", [name for name, page in PAGES.items() if pages.has_python(page)])
def test_code(name):
    """All code blocks of a page run in order, and print what the page says."""
    run(PAGES[name])


def test_first_script():
    """README's script has at most 30 lines, forces as in Hertz contact, and files for ParaView."""
    first = next(b.code for b in pages.blocks(PAGES["README.md"]) if b.language == "python")
    assert len([line for line in first.splitlines() if line.strip()]) <= 30
    names, files = run(PAGES["README.md"])
    assert {"block.xdmf", "block.h5", "ball.xdmf", "ball.h5"} <= set(files)
    contact = names["contact"]
    force, opposite = contact.force("slave"), contact.force("master")
    # Hertz's bodies are half-spaces. These bodies are clamped nearer to the contact, which makes
    # them stiffer by a quarter on finer meshes, and by a third on these.
    modulus = 1 / ((1 - 0.3**2) * (1 / 3e4 + 1 / 1e4))
    hertz = 4 / 3 * modulus * 0.05**1.5
    assert 1.2 * hertz < force[2] < 1.35 * hertz
    assert np.abs(force[:2]).max() < 0.02 * force[2]
    assert np.abs(force + opposite).max() < 1e-10 * force[2]
    assert names["problem"].num_iterations <= 8


def test_first_page(tmp_path, monkeypatch):
    """The site's script has at most 30 lines; forces balance, and friction is within its limit."""
    script = pages.ROOT / "docs/first.py"
    lines = [line for line in script.read_text(encoding="utf-8").splitlines() if line.strip()]
    assert len(lines) <= 30
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    contact = runpy.run_path(str(script))["contact"]
    force = contact.force("slave")
    assert np.abs(force + contact.force("master")).max() < 1e-9 * force[1]
    assert abs(force[0]) < 0.01 * force[1]  # symmetric except for the diagonals of cells
    assert (tmp_path / "first.png").exists()


def test_forging():
    """The last force is that of the closed form, half a step before the end."""
    names, _ = run(PAGES["docs/howto/forging.md"])
    height = 15 - 10 * 0.275
    area = np.pi * 10**2 * 15 / height
    expected = area * 50 * np.sqrt(3) ** 1.15 * (10 / height) ** 0.15
    assert np.isclose(-names["force"][1], expected, rtol=0.01)


def test_own_friction_law():
    """The law of CONTRIBUTING.md gives cohesion times area plus μ times the load at full slip."""
    names, _ = run(PAGES["CONTRIBUTING.md"])
    T, N = names["contact"].force("slave")
    assert np.isclose(abs(T), names["c"] * 2.0 + names["mu"] * N, rtol=1e-8)
    assert abs(T) > 1.2 * names["mu"] * N


class Parsed(Exception):
    """Raised after a program has parsed its arguments."""


def parse(program, arguments, monkeypatch):
    """Let a program parse arguments, and stop it there."""
    original = argparse.ArgumentParser.parse_args

    def parse_args(self, *args, **kwargs):
        original(self, *args, **kwargs)
        raise Parsed

    path = pages.ROOT / program
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    monkeypatch.setattr(sys, "argv", [str(path), *arguments])
    monkeypatch.syspath_prepend(str(path.parent))
    with pytest.raises(Parsed):
        runpy.run_path(str(path), run_name="__main__")


@pytest.mark.parametrize("name", [*PAGES, *PROGRAMS])
def test_commands(name, monkeypatch):
    """Programs, scripts and targets exist, and accept the documented options."""
    makefile = (pages.ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^([a-z-]+):", makefile, re.MULTILINE)
    for words in pages.commands((PAGES | PROGRAMS)[name]):
        line = " ".join(words)
        if words[0] == "make" and len(words) > 1:
            target = words[1]
            assert target in targets or re.fullmatch(r"test-(\d|N)", target), line
        for word in words:
            if re.fullmatch(r"(scripts/|\.ci/)[\w-]+", word):
                assert (pages.ROOT / word).exists(), line
        at = [i for i, word in enumerate(words) if PROGRAM.fullmatch(word)]
        if len(at) == 1:
            program, arguments = words[at[0]], words[at[0] + 1 :]
            assert (pages.ROOT / program).exists(), line
            if any(word.startswith("-") for word in arguments):
                with contextlib.redirect_stderr(sys.stdout), monkeypatch.context() as patch:
                    print(line)  # shown on failure
                    parse(program, arguments, patch)


@pytest.mark.parametrize("name", PAGES)
def test_links(name):
    """Links to files and headings of this repository have targets."""
    page = PAGES[name]
    for link in pages.links(page):
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), link
        if anchor:
            assert target.suffix == ".md" and anchor in pages.anchors(target), link


def test_demo_pages():
    """Every program among the demos has a page."""
    text = "".join(p.read_text(encoding="utf-8") for p in (pages.ROOT / "docs/demos").glob("*.md"))
    programs = [
        path.name
        for path in (pages.ROOT / "demos").glob("*.py")
        if "__main__" in path.read_text(encoding="utf-8") and not path.stem.endswith("_plot")
    ]
    assert len(programs) >= 10
    assert [name for name in programs if f"{{demo}} demos/{name}" not in text] == []


def test_site(tmp_path):
    """Sphinx, if installed, has no warnings on references, docstrings or missing pages."""
    build = pytest.importorskip("sphinx.cmd.build")
    pytest.importorskip("myst_parser")
    pytest.importorskip("furo")
    warnings = io.StringIO()
    status = 0
    if pages.WORLD.rank == 0:
        with contextlib.redirect_stderr(warnings):
            options = ["-b", "dummy", "-W", "--keep-going", "-q", "-d", str(tmp_path / "doctrees")]
            status = build.build_main([*options, str(pages.ROOT / "docs"), str(tmp_path)])
    assert pages.WORLD.bcast(status) == 0, warnings.getvalue()


def test_version():
    """The version is the same in all files."""
    citation = (pages.ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == qs.__version__
    changes = PAGES["CHANGELOG.md"].read_text(encoding="utf-8")
    assert re.search(r"^## (\S+)", changes, re.MULTILINE)[1] == qs.__version__
