"""Markdown pages, their code blocks and the commands in them, for the tests.

``python3 tests/project/pages.py PAGE...`` writes the printed output of code blocks into the text
blocks after them.
"""

import ast
import contextlib
import io
import logging
import os
import pathlib
import re
import shlex
import sys
import tempfile
import typing

from mpi4py import MPI

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORLD = MPI.COMM_WORLD


class Block(typing.NamedTuple):
    """A fenced code block, and the line of the page where it starts."""

    language: str
    line: int
    code: str


def without_fences(text):
    """Text of a page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def pages():
    """All pages of the documentation."""
    top = (
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "bench/peers/README.md",
        "paper/paper.md",
    )
    found = [ROOT / name for name in top] + sorted((ROOT / "docs").rglob("*.md"))
    return [page for page in found if page.exists()]


def blocks(page):
    """Fenced blocks of a page, from top to bottom."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(r"^```([^\n]*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [Block(m[1].strip(), text.count("\n", 0, m.start()) + 1, m[2]) for m in found]


def has_python(page):
    """Whether the page has code to run."""
    return any(block.language == "python" for block in blocks(page))


@contextlib.contextmanager
def scratch_folder():
    """Work in a new temporary folder, the same on all ranks."""
    old = os.getcwd()
    with contextlib.ExitStack() as stack:
        new = stack.enter_context(tempfile.TemporaryDirectory()) if WORLD.rank == 0 else None
        new = WORLD.bcast(new)
        os.chdir(new)
        try:
            yield pathlib.Path(new)
        finally:
            os.chdir(old)
            WORLD.barrier()


@contextlib.contextmanager
def logging_kept():
    """Restore our logging after a page, which may silence our messages."""
    logger = logging.getLogger("qsdolfinx")
    level, handlers = logger.level, [*logger.handlers]
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.handlers[:] = handlers


def printed_by(page):
    """Run a page's Python from top to bottom in one namespace.

    Returns:
        The namespace; pairs of each text block after a Python block and its expected text; and the
        names of the files that were written.
    """
    names, texts, printed = {"__name__": "page"}, [], None
    with scratch_folder() as folder, logging_kept():
        for block in blocks(page):
            if block.language == "text" and printed is not None:
                texts.append((block, printed))
            printed = None
            if block.language == "python":
                code = "\n" * block.line + block.code
                with contextlib.redirect_stdout(io.StringIO()) as out:
                    exec(compile(code, str(page), "exec"), names)
                printed = out.getvalue()
        WORLD.barrier()
        files = sorted(path.name for path in folder.iterdir())
        WORLD.barrier()
    return names, texts, files


def run(page):
    """Run a page and check its output on each rank; returns namespace and files."""
    names, texts, files = printed_by(page)
    unlike = [
        f"{page.name}, line {block.line}, prints:\n{printed}"
        for block, printed in texts
        if block.code != printed
    ]
    unlike = WORLD.allgather("\n".join(unlike))
    assert not any(unlike), "\n".join(unlike)
    return names, files


def fill(page):
    """Write the printed output into the text blocks."""
    lines = page.read_text(encoding="utf-8").split("\n")
    for block, printed in reversed(printed_by(page)[1]):
        end = block.line + block.code.count("\n")
        lines[block.line : end] = printed.rstrip("\n").split("\n")
    page.write_text("\n".join(lines), encoding="utf-8")


def commands(page):
    """Yield the commands on a page as lists of words: in backticks, fenced or indented.

    For a program, its docstring is the page.
    """
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".py":
        text = ast.get_docstring(ast.parse(text)) or ""
    spans = re.findall(r"(?<!`)`([^`]+)`(?!`)", without_fences(text))
    spans += re.findall(r"^    (\S.*)$", text, re.MULTILINE)
    for block in blocks(page):
        if block.language in ("sh", "console"):
            spans += re.sub(r"\\\n", " ", block.code).splitlines()
    for span in spans:
        with contextlib.suppress(ValueError):  # prose with an apostrophe
            words = shlex.split(" ".join(span.split()), comments=True)
            if words:
                yield words


def links(page):
    """Targets of the links and pictures of a page, without URLs."""
    text = without_fences(page.read_text(encoding="utf-8"))
    text = re.sub(r"`[^`\n]*`", "", text)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def anchors(page):
    """Valid anchors of a page: headings as GitHub and MyST write them, also of included pages."""
    text = without_fences(page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    included = re.findall(r"^```{include} (\S+)", page.read_text(encoding="utf-8"), re.MULTILINE)
    others = set().union(*(anchors((page.parent / name).resolve()) for name in included))
    return others | {heading.strip().replace(" ", "-") for heading in plain}


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        fill(pathlib.Path(argument).resolve())
