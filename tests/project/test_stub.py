"""The types of the extension, qsdolfinx/_cpp.pyi, are those that nanobind prints.

After a change of the bindings: ``python3 tests/project/test_stub.py > qsdolfinx/_cpp.pyi`` and
``make format``.
"""

import ast
import importlib.resources
import inspect

import pytest

from qsdolfinx import _cpp


def generated() -> str:
    stubgen = pytest.importorskip("nanobind.stubgen")
    stub = stubgen.StubGen(_cpp)
    stub.put(_cpp)
    return stub.get()


def declarations(text):
    """Classes and functions by name, because their order depends on the version of nanobind."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = inspect.cleandoc(node.value).strip()
    kinds = ast.ClassDef, ast.FunctionDef
    return {node.name: ast.unparse(node) for node in tree.body if isinstance(node, kinds)}


def test_stub_is_that_of_the_extension():
    installed = importlib.resources.files("qsdolfinx").joinpath("_cpp.pyi").read_text()
    assert declarations(installed) == declarations(generated())


if __name__ == "__main__":
    print(generated(), end="")
