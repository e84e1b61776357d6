"""Numeric constants of modules have a unit, a bound, and tests that notice a change."""

import ast
import importlib
import pathlib
import re

import numpy as np
import pytest
from constants_table import CHANGED, INDEPENDENT, NAMES_OF_OTHERS

from qsdolfinx.gap.following import MOST_TURNED
from qsdolfinx.surface.facets import SHARP

TESTS = pathlib.Path(__file__).resolve().parents[1]
ROOT = TESTS.parent / "qsdolfinx"

#: Words of which one says the unit, or to what a constant is relative.
UNITS = re.compile(
    r"\b(over|relative|part|parts|factor|ratio|angle|radians|cosine|sine|number|numbers|units?|"
    r"degree|quality|share|compliance|merit|size)\b",
    re.IGNORECASE,
)

#: A second part of a comment, which says what bounds the value.
BOUND = re.compile(r"[.:;] ?\S+ \S+ \S+")


def is_number(value):
    """Whether a value is a number, or numbers by a key, or in rows; no table of indices."""
    if isinstance(value, tuple) and value:
        return all(is_number(each) for each in value)
    if isinstance(value, dict) and value:
        keys = all(type(each) in (bool, int, str) for each in value)
        return keys and all(type(each) in (int, float) for each in value.values())
    return isinstance(value, int | float) and type(value).__name__ in ("int", "float", "float64")


def has_digits(node):
    """Whether an expression has a number of its own: others follow from other constants."""
    if isinstance(node, ast.Tuple):
        return any(has_digits(each) for each in node.elts)
    if isinstance(node, ast.Constant | ast.UnaryOp):
        return True
    numbers = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant))
    return any(is_number(number) and number != 1 for number in numbers)


def constants():
    """Yield the names of numeric constants of modules, and their comments."""
    for path in sorted(ROOT.rglob("*.py")):
        name = ".".join(("qsdolfinx", *path.relative_to(ROOT).with_suffix("").parts))
        module = importlib.import_module(name.removesuffix(".__init__"))
        lines = path.read_text().splitlines()
        for node in ast.parse(path.read_text()).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                continue
            above = node.lineno - 1
            while lines[above - 1].startswith("#"):
                above -= 1
            comment = " ".join(line.lstrip("#: ") for line in lines[above : node.lineno - 1])
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in (n for each in targets for n in ast.walk(each)):
                if isinstance(target, ast.Name) and has_digits(node.value):
                    if is_number(getattr(module, target.id)):
                        yield f"{path.relative_to(ROOT)}:{target.id}", comment


COMMENTS = dict(constants())


def test_each_constant_is_listed():
    """A new constant needs a test that notices its change: see tests/constants_table.py."""
    listed = [each.constant for each in CHANGED] + [*INDEPENDENT, *NAMES_OF_OTHERS]
    assert len(listed) == len(set(listed))
    assert set(COMMENTS) == set(listed)


@pytest.mark.parametrize("constant", sorted(set(COMMENTS) - set(NAMES_OF_OTHERS)))
def test_comment(constant):
    """It says what the constant is, with its unit, and then what bounds it."""
    comment = COMMENTS[constant]
    assert UNITS.search(comment) and BOUND.search(comment), comment


def test_tests_exist():
    wrong = []
    named = [(each.constant, test) for each in CHANGED for test in each.tests]
    for constant, test in [*named, *INDEPENDENT.items()]:
        path, _, name = test.partition("::")
        there = (TESTS / path).is_file() and f"def {name}(" in (TESTS / path).read_text()
        wrong += [f"{constant}: no {test}"] * (not there)
    assert not wrong


def test_values_differ():
    """Each changed value differs from the constant."""
    for each in CHANGED:
        path, _, name = each.constant.partition(":")
        module = importlib.import_module(f"qsdolfinx.{path[:-3].replace('/', '.')}")
        assert each.values and getattr(module, name) not in each.values, each.constant


def test_no_default_values():
    """A constant that is a default value of an argument could not be changed in a test."""
    names = {constant.partition(":")[2] for constant in COMMENTS}
    found = [
        f"{path.relative_to(ROOT)}, line {node.lineno}: {ast.unparse(default)}"
        for path in ROOT.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.Lambda)
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults))
        if isinstance(default, ast.Name) and default.id in names
    ]
    assert found == []


def of_cpp(file, name):
    """Value of a constant of the extension."""
    text = (ROOT.parent / "cpp" / file).read_text()
    return float(re.search(rf"constexpr double {name} = ([-+.\de]+);", text)[1])


def test_same_numbers_in_the_extension():
    """Numbers that Python and the extension share are the same."""
    assert of_cpp("sliding/ray.cpp", "most_turned") == MOST_TURNED
    # A little less, so that rounding does not decide about polygons of 12 sides.
    assert 1e-7 < np.cos(SHARP) - of_cpp("surface/surface.h", "smooth_cosine") < 1e-6
