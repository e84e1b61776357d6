"""Tests use public names only: names with a leading underscore stay in their module."""

import ast
import pathlib

TESTS = pathlib.Path(__file__).resolve().parents[1]

#: Names that named tuples document, and that DOLFINx's partitioners have to return.
PUBLIC = {"_asdict", "_fields", "_replace", "_cpp_object"}

#: Functions that take a name as a string.
BY_NAME = {"getattr", "hasattr", "setattr", "delattr"}


def private_names(source):
    """Private names of objects other than ``self`` that are used, with their lines."""
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Attribute):
            owner = node.value
            if not (isinstance(owner, ast.Name) and owner.id in ("self", "cls")):
                names.append(node.attr)
        elif isinstance(node, ast.Call):
            function = node.func
            if getattr(function, "attr", getattr(function, "id", "")) in BY_NAME:
                names += [a.value for a in node.args if isinstance(a, ast.Constant)]
        elif isinstance(node, ast.ImportFrom):
            names += [alias.name for alias in node.names if alias.name != "_cpp"]
        for name in names:
            if isinstance(name, str) and name.startswith("_") and not name.startswith("__"):
                if name not in PUBLIC:
                    yield f"line {node.lineno}: {name}"


def test_no_private_names():
    found = {
        str(path.relative_to(TESTS)): list(private_names(path.read_text(encoding="utf-8")))
        for path in sorted(TESTS.rglob("*.py"))
    }
    assert len(found) > 60
    assert {path: names for path, names in found.items() if names} == {}


def test_private_names_are_found():
    source = """
from a import _b
self._c, d._replace(), e.f._g
monkeypatch.setattr(h, "_i", 0)
getattr(j, "k")._l()
"""
    names = sorted(found.split()[-1] for found in private_names(source))
    assert names == ["_b", "_g", "_i", "_l"]
