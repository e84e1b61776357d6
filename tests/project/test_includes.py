"""C++ sources include only lower layers, with paths relative to cpp/."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2] / "cpp"

#: Layers from low to high: a folder may include those before it.
FLOORS = (
    "parallel",
    "geometry",
    "surface",
    "search",
    "sliding",
    "pairing",
    "gap",
    "tangent",
    "linear",
    "bindings",
)

INCLUDES = [
    (path.relative_to(ROOT), pathlib.PurePath(name))
    for path in sorted(ROOT.rglob("*.*"))
    if path.suffix in (".h", ".cpp")
    for name in re.findall('^#include "(.*)"', path.read_text(), re.MULTILINE)
]


def test_every_folder_has_a_floor():
    assert {path.parts[0] for path, _ in INCLUDES} == set(FLOORS)


def test_includes_run_downwards():
    upwards = [
        f"{path} includes {name}"
        for path, name in INCLUDES
        if FLOORS.index(name.parts[0]) > FLOORS.index(path.parts[0])
    ]
    assert upwards == []


def test_no_circles():
    """Headers have no circular includes; a .cpp file may include any header of its folder."""
    needs = {}
    for path, name in INCLUDES:
        if path.suffix == ".h":
            needs.setdefault(path, set()).add(pathlib.Path(name))
    while free := [path for path, names in needs.items() if not names & set(needs)]:
        for path in free:
            del needs[path]
    assert needs == {}
