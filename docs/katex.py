"""Formulas of the site by KaTeX, which is copied into it: its pages load nothing from elsewhere.

Formulas that KaTeX does not know are warned of, and so end the build.
"""

import os
import pathlib
import re
import shutil

from docutils import nodes
from sphinx.errors import ExtensionError
from sphinx.util import logging

#: Where Debian's libjs-katex and fonts-katex are, or the folder `dist` of a release of KaTeX.
SOURCE = pathlib.Path(os.environ.get("KATEX", "/usr/share/javascript/katex"))
FILES = ("katex.min.js", "katex.min.css")


def faults(formula, known=None):
    """What is wrong with a formula: commands that are not known, groups that do not close."""
    found = []
    if known is not None:
        names = set(re.findall(r"\\[A-Za-z]+", formula)) - {r"\begin", r"\end", r"\left", r"\right"}
        found += [f"unknown {name}" for name in sorted(names - known)]
    bare = re.sub(r"\\[\\{}$]", "", formula)
    depth = 0
    for brace in re.findall("[{}]", bare):
        depth += 1 if brace == "{" else -1
        if depth < 0:
            break
    if depth:
        found.append("braces do not match")
    if len(re.findall(r"\\left\b", bare)) != len(re.findall(r"\\right\b", bare)):
        found.append(r"\left without \right")
    if re.search(r"[^\x00-\x7f]", bare):
        found.append("letters that are not ASCII")
    return found


def known_commands():
    """All commands that are named in KaTeX's source; None without KaTeX."""
    script = SOURCE / FILES[0]
    if not script.exists():
        return None
    return set(re.findall(r"\\(\\[A-Za-z]+)", script.read_text(encoding="utf-8")))


def check(app, document):
    """Warn of formulas that would not be typeset."""
    known = known_commands()
    for node in document.findall(lambda n: isinstance(n, nodes.math | nodes.math_block)):
        for fault in faults(node.astext(), known):
            logging.getLogger(__name__).warning("formula: %s", fault, location=node)


def copy(app, exception):
    """Put script, style and fonts into the site."""
    if exception or app.builder.format != "html":
        return
    target = pathlib.Path(app.outdir) / "_static" / "katex"
    shutil.rmtree(target, ignore_errors=True)
    (target / "fonts").mkdir(parents=True)
    for name in FILES:
        shutil.copyfile(SOURCE / name, target / name)
    for font in (SOURCE / "fonts").glob("*.woff2"):
        shutil.copyfile(font, target / "fonts" / font.name)


def begin(app):
    """Ask for what the pages load."""
    if app.builder.format != "html":
        return
    if missing := [name for name in FILES if not (SOURCE / name).exists()]:
        raise ExtensionError(
            f"{SOURCE} has no {missing[0]}: install libjs-katex and fonts-katex (Debian), or "
            "set KATEX to the folder dist of a release of KaTeX"
        )


def visit_inline(translator, node):
    """A formula in a line; the TeX source is there for readers without scripts."""
    translator.body.append(translator.starttag(node, "span", "", CLASS="formula"))
    translator.body.append(translator.encode(node.astext()) + "</span>")
    raise nodes.SkipNode


def visit_block(translator, node):
    """A formula of its own."""
    translator.body.append(translator.starttag(node, "div", "", CLASS="formula"))
    translator.body.append(translator.encode(node.astext()) + "</div>\n")
    raise nodes.SkipNode


def setup(app):
    """Register what is above as the renderer `katex`."""
    app.add_html_math_renderer("katex", (visit_inline, None), (visit_block, None))
    app.connect("builder-inited", begin)
    app.connect("doctree-read", check)
    app.connect("build-finished", copy)
    return {"parallel_read_safe": True}
