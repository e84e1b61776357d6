"""Versions and dependencies are the same in all files that packages are made from."""

import importlib.util
import re
import sys

import pytest
from project.pages import ROOT

import qsdolfinx as qs

tomllib = pytest.importorskip("tomllib")
yaml = pytest.importorskip("yaml")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
#: Debian names of Python packages.
DEBIAN = {
    "fenics-dolfinx": "python3-dolfinx-real",
    "mpi4py": "python3-mpi4py",
    "petsc4py": "python3-petsc4py-real",
    "numpy": None,  # comes with DOLFINx
    "nanobind": "python3-nanobind",
    "scikit-build-core": "python3-scikit-build-core",
}
#: Packages of debian-packages.txt that are for pip, or have another name in a control file.
NOT_IN_CONTROL = {"python3-pip", "pkg-config", "python3-pytest-xdist", "g++"}
#: Packages that any Debian package needs for its build.
DEBHELPERS = {"debhelper-compat", "dh-sequence-python3", "pybuild-plugin-pyproject", "pkgconf"}


def split(requirement):
    """Name and version of a requirement such as fenics-dolfinx>=0.9."""
    name, version = re.fullmatch(r"([\w-]+)\s*(.*)", requirement).groups()
    return name, version


def recipe(section):
    """Requirements of the recipe, with the expressions of its context replaced."""
    found = set()
    for entry in RECIPE["requirements"][section]:
        if isinstance(entry, str):
            known = re.sub(r"\${{ (\w+) }}", lambda m: RECIPE["context"].get(m[1], m[0]), entry)
            found.add(tuple(known.split(" ", 1)) if " " in known else (known, ""))
    return found


def control(field):
    """Names in a field of packaging/debian/control, without versions and profiles."""
    text = (ROOT / "packaging/debian/control").read_text(encoding="utf-8")
    entries = re.search(rf"^{field}:\n((?: .*\n)+)", text, re.MULTILINE)[1].splitlines()
    return {entry.split()[0].strip(",") for entry in entries if not entry.startswith(" $")}


def listed():
    """Sections of debian-packages.txt by their first words."""
    text = (ROOT / "debian-packages.txt").read_text(encoding="utf-8")
    sections = re.findall(r"^# (\w+).*\n((?:(?:#.*|\S+)\n)+)", text, re.MULTILINE)
    return {
        name: {line for line in lines.splitlines() if not line.startswith("#")}
        for name, lines in sections
    }


def test_version():
    """Recipe and changelog have the version; CITATION.cff and CHANGELOG.md are in test_docs.py."""
    assert RECIPE["context"]["version"] == qs.__version__
    changelog = (ROOT / "packaging/debian/changelog").read_text(encoding="utf-8")
    assert re.match(r"qsdolfinx \(([^-]*)-\d+\) ", changelog)[1] == qs.__version__


def test_recipe_has_what_pyproject_names():
    """The recipe has the names and bounds of pyproject.toml, to build and to run."""
    run = {split(requirement) for requirement in PROJECT["project"]["dependencies"]}
    assert run <= recipe("run")
    assert {name for name, _ in recipe("run")} - {name for name, _ in run} == {"python", "petsc"}
    build = {split(requirement) for requirement in PROJECT["build-system"]["requires"]}
    assert build | (run - {("numpy", "")}) <= recipe("host")
    oldest = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert f'match(python, "<{oldest}")' in RECIPE["build"]["skip"]


def test_recipe_builds_with_cmake_that_is_asked_for():
    cmake = (ROOT / "cpp/CMakeLists.txt").read_text(encoding="utf-8")
    oldest = re.search(r"cmake_minimum_required\(VERSION ([\d.]+)\)", cmake)[1]
    assert ("cmake", f">={oldest}") in recipe("build")


def test_debian_has_what_pyproject_names():
    run = {DEBIAN[split(r)[0]] for r in PROJECT["project"]["dependencies"]} - {None}
    assert control("Depends") == run
    build = {DEBIAN[split(r)[0]] for r in PROJECT["build-system"]["requires"]}
    assert run | build <= control("Build-Depends")


def test_debian_has_what_is_listed():
    """Packages in control are those of debian-packages.txt, which the tests use."""
    packages = listed()
    assert {"runtime", "build", "test", "lint", "pictures"} <= set(packages)
    built = control("Build-Depends")
    assert packages["build"] - NOT_IN_CONTROL <= built
    everything = set().union(*packages.values())
    assert built - DEBHELPERS <= everything
    offered = control("Depends") | control("Recommends") | control("Suggests")
    assert packages["runtime"] <= offered <= everything


def backend():
    """The build backend, as a module."""
    pytest.importorskip("scikit_build_core")
    spec = importlib.util.spec_from_file_location("backend", ROOT / "packaging/backend.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_missing_dolfinx_is_said_in_one_line(monkeypatch):
    module = backend()
    find = importlib.util.find_spec
    monkeypatch.setattr(module, "find_spec", lambda name: name != "dolfinx" and find(name))
    for hook in ("get_requires_for_build_wheel", "prepare_metadata_for_build_wheel", "build_wheel"):
        with pytest.raises(SystemExit) as end:
            getattr(module, hook)("nowhere")
        message = end.value.code
        assert "no dolfinx:" in message and "\n" not in message
        assert DEBIAN["fenics-dolfinx"] in message and "--no-build-isolation" in message
    module.get_requires_for_build_sdist({})  # needs none of these packages


def test_present_dolfinx_is_found():
    """If all requirements are present, the hook is that of scikit-build-core."""
    if importlib.util.find_spec("nanobind") is None:
        pytest.skip("no nanobind")
    assert isinstance(backend().get_requires_for_build_wheel({}), list)


def test_backend_is_the_one_in_pyproject():
    system = PROJECT["build-system"]
    assert (ROOT / system["backend-path"][0] / f"{system['build-backend']}.py").exists()


def test_paper_cites_what_is_in_its_bibliography():
    """Every cited key exists; every entry is cited, and has a place to find it."""
    text = (ROOT / "paper/paper.md").read_text(encoding="utf-8")
    bibliography = (ROOT / "paper/paper.bib").read_text(encoding="utf-8")
    entries = dict(re.findall(r"^@\w+{(\w+),\n(.*?)^}", bibliography, re.MULTILINE | re.DOTALL))
    assert set(re.findall(r"@([A-Za-z]+\d*)", text)) == set(entries)
    assert all(re.search(r"^  (doi|url) ", entry, re.MULTILINE) for entry in entries.values())


def test_paper_has_the_authors_of_the_citation():
    head = yaml.safe_load((ROOT / "paper/paper.md").read_text(encoding="utf-8").split("---\n")[1])
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert [a["name"] for a in head["authors"]] == [a["name"] for a in citation["authors"]]
    assert head["title"] == citation["title"]


def faults(formula):
    """Faults that docs/katex.py finds in a formula."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        module = pytest.importorskip("katex", reason="no docutils or Sphinx")
    finally:
        sys.path.pop(0)
    return module.faults(formula, module.known_commands())


def test_faulty_formulas_are_found():
    """Faulty formulas, which must stop the build of the site, are found."""
    assert faults(r"\frac{1}{2} \left[ x \right]_+ \{y\}") == []
    assert faults(r"\frac{1}{2") == faults("}{") == ["braces do not match"]
    assert faults(r"\left( x") == [r"\left without \right"]
    assert faults("ε") == ["letters that are not ASCII"]
