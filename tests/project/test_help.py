"""``help()`` lists all public attributes of classes, also those that ``__init__`` sets."""

import ast
import inspect
import pydoc
import re
import textwrap

import pytest

import qsdolfinx as qs


def public_classes():
    for name in sorted(qs.__all__):
        thing = getattr(qs, name)
        found = [kind for _, kind in inspect.getmembers(thing, inspect.isclass)]
        for kind in [thing] if inspect.isclass(thing) else found:
            if kind.__module__.startswith("qsdolfinx") and kind.__name__[0] != "_":
                yield kind


def attributes(kind):
    """Public names that methods of a class, or of its bases in the package, assign to self."""
    for base in kind.__mro__:
        if base.__module__.startswith("qsdolfinx"):
            try:
                source = inspect.getsource(base)
            except OSError:  # made by dataclasses or enum
                continue
            for node in ast.walk(ast.parse(textwrap.dedent(source))):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                    if isinstance(node.value, ast.Name) and node.value.id == "self":
                        if not node.attr.startswith("_"):
                            yield node.attr


CLASSES = sorted(set(public_classes()), key=lambda kind: kind.__qualname__)


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__qualname__)
def test_attributes_are_in_help(kind):
    """Each attribute starts a line: as a property, or in the docstring of the class."""
    text = pydoc.plain(pydoc.render_doc(kind))
    missing = [a for a in set(attributes(kind)) if not re.search(rf"^ \|  +{a}\b", text, re.M)]
    assert not missing
