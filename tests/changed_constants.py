"""Plugin of pytest for constants.py: run tests again with changed constants of the package.

A constant is changed in its module, in the modules that import it by name, and in the constants of
modules that are computed from it.
"""

import ast
import functools
import gc
import importlib
import json
import os
import pathlib
import signal
import sys
import types
import typing

import pytest
from _pytest.runner import runtestprotocol
from constants_table import CHANGED, Changed

import qsdolfinx as qs

ROOT = pathlib.Path(qs.__file__).parent

#: Environment variables: file for the results, and constants that are changed (JSON).
RESULTS, CHOSEN = "QSDOLFINX_CHANGED_RESULTS", "QSDOLFINX_CHANGED"

#: Seconds in which a test must end with a changed constant, besides ten times its usual time.
PATIENCE = 20

#: Type of functions whose results are kept.
CACHED = type(functools.cache(len))


class Module(typing.NamedTuple):
    """A module of the package.

    Attributes:
        module: The module.
        assigned: Assignments at its top level.
        imported: Module and name of what it imports from the package, by the name that it uses.
    """

    module: types.ModuleType
    assigned: list[ast.Assign | ast.AnnAssign]
    imported: dict[str, tuple[str, str]]


@functools.cache
def modules() -> dict[str, Module]:
    """All modules of the package, by their names."""
    found = {}
    for path in ROOT.rglob("*.py"):
        parts = ("qsdolfinx", *path.relative_to(ROOT).with_suffix("").parts)
        name = ".".join(parts).removesuffix(".__init__")
        tree = ast.parse(path.read_text())
        imported = {
            alias.asname or alias.name: (node.module or "", alias.name)
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        assigned = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
        found[name] = Module(importlib.import_module(name), assigned, imported)
    return found


def assign(name: str, constant: str, value: object, patch: pytest.MonkeyPatch) -> None:
    """Set a constant of a module, and all that has been computed from it in any module."""
    patch.setattr(modules()[name].module, constant, value)
    known = {name: constant}
    for other, each in modules().items():
        for alias, origin in each.imported.items():
            if origin == (name, constant):
                patch.setattr(each.module, alias, value)
                known[other] = alias
    for other, alias in known.items():
        for node in modules()[other].assigned:
            if node.value is not None and alias in names(node.value):
                again: dict[str, object] = {}
                exec(ast.unparse(node), vars(modules()[other].module), again)
                for target, computed in again.items():
                    if target != "__annotations__":
                        assign(other, target, computed, patch)


def names(node: ast.AST) -> set[str]:
    """Names in an expression."""
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def clear_caches() -> None:
    """Forget results of cached functions of the package and the tests."""
    for each in gc.get_objects():
        if isinstance(each, CACHED) and each is not modules:
            file = getattr(sys.modules.get(each.__module__), "__file__", None) or ""
            if "qsdolfinx" in each.__module__ or "/tests/" in file:
                each.cache_clear()


def chosen(item: pytest.Item) -> list[Changed]:
    """Constants that the tests of an item's function should notice."""
    function = item.nodeid.partition("[")[0].removeprefix("tests/")
    named = {function, function.partition("::")[0]}
    wanted = json.loads(os.environ[CHOSEN])
    return [each for each in CHANGED if each.constant in wanted and named & set(each.tests)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests that are named."""
    items[:] = [item for item in items if chosen(item)]


def alarm(*_: object) -> None:
    """End a test that does not end by itself."""
    raise TimeoutError


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test, and run it again with each change."""
    signal.signal(signal.SIGALRM, alarm)
    reports = runtestprotocol(item, nextitem=None, log=False)
    if any(report.failed for report in reports):
        write(item, "", 0, True)
        return True
    usual = sum(report.duration for report in reports)
    for each in chosen(item):
        path, _, constant = each.constant.partition(":")
        name = ".".join(("qsdolfinx", *pathlib.PurePath(path).with_suffix("").parts))
        for i, value in enumerate(each.values):
            with pytest.MonkeyPatch.context() as patch:
                clear_caches()
                assign(name, constant, value, patch)
                signal.alarm(int(10 * usual) + PATIENCE)
                try:
                    reports = runtestprotocol(item, nextitem=None, log=False)
                    failed = any(report.failed for report in reports)
                except TimeoutError:
                    failed = True
                finally:
                    signal.alarm(0)
            write(item, each.constant, i, failed)
    clear_caches()
    return True


def write(item: pytest.Item, constant: str, value: int, failed: bool) -> None:
    """Add one result to the file."""
    with pathlib.Path(os.environ[RESULTS]).open("a") as file:
        file.write(json.dumps([item.nodeid, constant, value, failed]) + "\n")
