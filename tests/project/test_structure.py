"""Rules for the structure of the sources: see docs/design.md."""

import ast
import json
import os
import pathlib
import subprocess
import sys

import pytest
from scenes import WORLD

ROOT = pathlib.Path(__file__).resolve().parents[2] / "qsdolfinx"

#: Layers from low to high: a folder or module may import those before it, not from its own layer.
FLOORS = (
    ("_cpp",),
    ("base", "compat"),
    ("surface", "materials"),
    ("output", "plasticity", "tools"),
    ("pairing",),
    ("gap",),
    ("friction",),
    ("contact",),
    ("system",),
    ("linear",),
    ("remeshing", "solve"),
    ("steps",),
    ("__init__",),
)
FLOOR = {name: i for i, names in enumerate(FLOORS) for name in names}

FILES = sorted(ROOT.rglob("*.py"))
TREES = {path: ast.parse(path.read_text()) for path in FILES}


def room(path):
    """Name of the folder, or of the module directly in the package."""
    first = path.relative_to(ROOT).parts[0]
    return first.removesuffix(".py")


def imported(tree):
    """Folders and modules of the package that a module imports from."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "qsdolfinx":
            parts = node.module.split(".")[1:]
            yield from [parts[0]] if parts else [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            for alias in node.names:
                parts = alias.name.split(".")
                if parts[0] == "qsdolfinx":
                    yield parts[1] if len(parts) > 1 else "__init__"


def test_every_folder_has_a_floor():
    assert {room(path) for path in FILES} | {"_cpp"} == set(FLOOR)


def test_imports_run_downwards():
    upwards = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path, tree in TREES.items()
        for name in imported(tree)
        if name != room(path) and FLOOR[name] >= FLOOR[room(path)]
    ]
    assert upwards == []


def test_no_circles_within_a_folder():
    """There are no circular imports: each module can be imported by itself."""
    modules = {path: ".".join(("qsdolfinx", *path.relative_to(ROOT).with_suffix("").parts))
               for path in FILES if path.name != "__init__.py"}  # fmt: skip
    of = {
        name: {
            node.module if node.module in modules.values() else f"{node.module}.{alias.name}"
            for node in ast.walk(TREES[path])
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qsdolfinx.")
            for alias in node.names
        }
        & set(modules.values())
        for path, name in modules.items()
    }
    while free := [name for name, needs in of.items() if not needs & set(of)]:
        for name in free:
            del of[name]
    assert of == {}


def test_no_class_continues_in_another_file():
    """Classes do not derive from classes of other files.

    Interfaces with several implementations, errors and laws are exceptions.
    """
    where = {
        node.name: path
        for path, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    continued = [
        f"{node.name} in {path.relative_to(ROOT)} continues {base.id}"
        for path, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for base in node.bases
        if isinstance(base, ast.Name)
        and where.get(base.id, path) != path
        and not base.id.endswith(("Warning", "Error"))
    ]
    assert continued == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_private_names_stay_in_their_file(path):
    """An object's ``_name`` is used by its own class and within the same file only."""
    classes = {node.name for node in ast.walk(TREES[path]) if isinstance(node, ast.ClassDef)}
    own = {
        node.attr
        for node in ast.walk(TREES[path])
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in {"self", "cls", *classes}
    }
    foreign = {"_asdict", "_replace", "_fields", "_cpp_object"}  # of Python and DOLFINx
    found = [
        f"line {node.lineno}: {ast.unparse(node)}"
        for node in ast.walk(TREES[path])
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and not node.attr.startswith("__")
        and node.attr not in own | foreign
    ]
    assert found == []


def test_tools_and_bodies_answer_the_same_questions():
    """Few rules of contact depend on whether a side is a body or a rigid tool.

    Types of sides and of their positions are compared only where these are defined, and where the
    arguments of the user are checked. A new case is a method of both classes, or a loop over
    ``bodies`` or ``tools``.
    """
    kinds = {"Surface", "RigidSurface", "Place", "ToolPlace"}
    asked, compared = [], []
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            where = f"{path.relative_to(ROOT)}, line {node.lineno}"
            if node.func.id == "is_rigid":
                asked.append(where)
            if node.func.id == "isinstance":
                names = {name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)}
                compared += [where] if names & kinds else []
    assert len(asked) <= 15, asked
    homes = ("tools/rigid_surface.py", "contact/placement.py")
    assert [where for where in compared if not where.startswith(homes)] == []
    assert len(compared) <= 2, compared


def test_a_demo_is_read_from_top_to_bottom():
    """Each program has at most 150 lines.

    Bodies, pictures, tables and files are in other modules beside it.
    """
    texts = {path.name: path.read_text() for path in ROOT.parent.glob("demos/*.py")}
    lines = {name: text.count("\n") for name, text in texts.items() if "__main__" in text}
    assert len(lines) >= 10
    assert {name: number for name, number in lines.items() if number > 150} == {}


def test_importing_changes_nothing():
    """Importing the package changes nothing in a clean interpreter, after DOLFINx is imported."""
    if WORLD.rank > 0:
        return
    program = """
import dolfinx, json, logging, signal, sys
import dolfinx.fem.petsc, dolfinx.io
loggers = lambda: {n: len(getattr(l, "handlers", ())) for n, l in logging.root.manager.loggerDict.items()}
state = lambda: [id(sys.excepthook), id(sys.stdout), id(sys.stderr), len(logging.root.handlers),
                 logging.root.level, id(signal.getsignal(signal.SIGINT))]
before, named = state(), loggers()
import qsdolfinx
after = loggers()
print(json.dumps([before, state(), [n for n, k in after.items() if k != named.get(n, 0)]]))
"""  # noqa: E501
    alone = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PRTE_"))}
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=alone, check=True
    )
    before, after, handlers = json.loads(run.stdout.splitlines()[-1])
    assert before == after and handlers == []
