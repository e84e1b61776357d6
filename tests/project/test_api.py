"""Public names and their signatures are as recorded in api.txt.

After an intended change: ``python3 tests/project/test_api.py > tests/project/api.txt``.
"""

import enum
import inspect
import pathlib

import qsdolfinx as qs

RECORDED = pathlib.Path(__file__).with_name("api.txt")


def members(kind):
    """Public members of a class, one per line, without those that all exceptions have."""
    for name in sorted(set(dir(kind)) - {*dir(Exception), *dir(int)}):
        if name.startswith("_"):
            continue
        found = inspect.getattr_static(kind, name)
        if isinstance(found, (classmethod, staticmethod)) or inspect.isfunction(found):
            yield f"{kind.__name__}.{name}{inspect.signature(getattr(kind, name))}"
        elif isinstance(found, property):
            yield f"{kind.__name__}.{name}" + (", can be set" if found.fset else "")
        else:
            yield f"{kind.__name__}.{name}"


def public_names():
    for name in sorted(qs.__all__):
        thing = getattr(qs, name)
        if inspect.isclass(thing):
            plain = issubclass(thing, (Exception, enum.Enum)) and "__init__" not in vars(thing)
            yield name if plain else f"{name}{inspect.signature(thing)}"
            yield from members(thing)
        elif inspect.isfunction(thing):
            yield f"{name}{inspect.signature(thing)}"
        else:
            functions = inspect.getmembers(thing, inspect.isfunction)
            own = [(f, value) for f, value in functions if value.__module__ == thing.__name__]
            yield from (f"{name}.{f}{inspect.signature(value)}" for f, value in own if f[0] != "_")
            for _, kind in inspect.getmembers(thing, inspect.isclass):
                if kind.__module__ == thing.__name__ and kind.__name__[0] != "_":
                    yield f"{name}.{kind.__name__}{inspect.signature(kind)}"
                    yield from (f"{name}.{member}" for member in members(kind))


#: Computed on import, because a fixture of all tests wraps a constructor.
FOUND = list(public_names())


def test_public_names_and_signatures_are_those_recorded():
    assert FOUND == RECORDED.read_text().splitlines()


if __name__ == "__main__":
    print("\n".join(FOUND))
