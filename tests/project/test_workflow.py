"""Workflows, container image and Makefile are consistent."""

import json
import pathlib
import re

import pytest

yaml = pytest.importorskip("yaml")

ROOT = pathlib.Path(__file__).resolve().parents[2]
SECTIONS = {"runtime", "build", "test", "pictures", "lint"}


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def workflows():
    """The workflows of the repository, and those shown in docs/ci.md."""
    found = {p.name: p.read_text(encoding="utf-8") for p in ROOT.glob(".github/workflows/*.yml")}
    shown = re.findall(r"^```yaml\n(.*?)^```$", text("docs/ci.md"), re.MULTILINE | re.DOTALL)
    return found | {f"docs/ci.md, {i}": code for i, code in enumerate(shown)}


WORKFLOWS = workflows()


def commands(workflow):
    """All commands that the steps of a workflow run."""
    jobs = yaml.safe_load(workflow)["jobs"].values()
    return [step["run"] for job in jobs for step in job["steps"] if "run" in step]


def targets():
    """Targets of the Makefile."""
    return set(re.findall(r"^([a-z][\w-]*):", text("Makefile"), re.MULTILINE))


def unknown_targets(workflow):
    """Make targets in a workflow that are not in the Makefile."""
    made = {t for c in commands(workflow) for t in re.findall(r"\bmake ([\w-]+)", c)}
    return {t for t in made if t not in targets() and not re.fullmatch(r"test-\d", t)}


def test_there_are_some():
    assert "contact.yml" in WORKFLOWS and len(WORKFLOWS) >= 2


@pytest.mark.parametrize("name", WORKFLOWS)
def test_workflow(name):
    """A workflow parses, has jobs with a runner and a time limit, and names existing files."""
    parsed = yaml.safe_load(WORKFLOWS[name])
    assert parsed["name"] and (True in parsed or "on" in parsed)  # YAML 1.1: on is true
    assert parsed["permissions"] == {"contents": "read"}
    for job in parsed["jobs"].values():
        assert job["runs-on"] and job["timeout-minutes"] > 0
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step)
            assert "@v" in step.get("uses", "@v")
    assert not unknown_targets(WORKFLOWS[name])
    for command in commands(WORKFLOWS[name]):
        for path in re.findall(r"\b(?:demos|scripts|bench|tests)/[\w*]+(?:\.py)?", command):
            assert list(ROOT.glob(path)), path
        for sections in re.findall(r'SECTIONS="([^"]*)"', command):
            assert set(sections.split()) <= SECTIONS


def test_unknown_target_is_found():
    workflow = "jobs: {a: {steps: [{run: docker run image make tset}, {run: make test-2 lint}]}}"
    assert unknown_targets(workflow) == {"tset"}


def test_repository_workflow_makes_lint_and_test():
    made = " ".join(commands(WORKFLOWS["contact.yml"]))
    assert "make lint" in made and "make test" in made and "docker build" in made


def test_image():
    """The image runs the command of `make demo` by default, not as root, and has the labels."""
    dockerfile = text("Dockerfile")
    demo = re.search(r"^DEMO = (.*)$", text("Makefile"), re.MULTILINE)[1].split()
    assert json.loads(re.search(r"^CMD (.*)$", dockerfile, re.MULTILINE)[1]) == demo
    user = re.search(r"^USER (\w+)$", dockerfile, re.MULTILINE)[1]
    assert user != "root" and f"useradd --create-home {user}" in dockerfile
    labels = dict(re.findall(r'org\.opencontainers\.image\.(\w+)="([^"]*)"', dockerfile))
    project = text("pyproject.toml") + text("qsdolfinx/__init__.py")
    version = re.search(r'^(?:__version__|version) = "(.*)"$', project, re.MULTILINE)[1]
    description = re.search(r'^description = "(.*)"$', project, re.MULTILINE)[1]
    assert labels["version"] == version and labels["title"] == "qsdolfinx"
    assert labels["description"] == description and labels["licenses"] == "MIT"
    assert labels["source"] == "$SOURCE"


def test_package_sections():
    """The sections used in the Dockerfile exist; lint is the only other section."""
    headings = re.findall(r"\n\n# (\w+)", text("debian-packages.txt"))
    default = re.search(r'^ARG SECTIONS="(.*)"$', text("Dockerfile"), re.MULTILINE)[1].split()
    assert set(headings) == SECTIONS and set(default) == SECTIONS - {"lint"}
