"""docs/design.md: files of its map exist and define the names; the drawing has all folders."""

import re

from project import pages

PAGE = (pages.ROOT / "docs" / "design.md").read_text(encoding="utf-8")
FOLDERS = "qsdolfinx", "cpp"


def rows():
    """Cells of the map: where, Python, C++."""
    table = PAGE.split("| where | Python | C++ |\n|---|---|---|\n")[1].split("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def definition(name, path):
    """Pattern of a definition; for a C++ class, of its constructor."""
    if path.endswith(".py"):
        return rf"^(def|class) {name}\b"
    return rf"{name}::{name}\(" if name[0].isupper() else rf"\b{name}\("


def test_map():
    assert 10 <= len(rows()) <= 15
    for where, *cells in rows():
        assert cells[0], where
        for folder, cell in zip(FOLDERS, cells, strict=True):
            if cell:
                path, name, *others = re.findall("`([^`]+)`", cell)
                source = (pages.ROOT / folder / path).read_text(encoding="utf-8")
                assert re.search(definition(name, path), source, re.MULTILINE), (where, path)
                assert [n for n in others if not re.search(rf"\b{n}\b", source)] == [], where


def test_other_files():
    """Files that the text names exist."""
    paths = re.findall(r"`((?:\w+/)+\w+\.(?:py|cpp))`", PAGE)
    assert len(paths) > 30
    for path in paths:
        assert any((pages.ROOT / folder / path).exists() for folder in ("", *FOLDERS)), path


def test_drawing():
    """Every folder and module of the package has a line in the drawing."""
    drawing = PAGE.split("```text\n")[1].split("```")[0]
    package = pages.ROOT / "qsdolfinx"
    names = {f"{p.name}/" for p in package.iterdir() if any(p.glob("*.py"))}
    names |= {p.name for p in package.glob("*.py")}
    names |= {p.name for p in (pages.ROOT / "cpp").iterdir() if any(p.glob("*.h"))}
    assert len(names) > 20
    assert [name for name in sorted(names) if name not in drawing] == []
