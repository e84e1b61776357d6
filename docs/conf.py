"""Sphinx configuration: ``make docs`` builds the site in build/docs."""

import ast
import pathlib
import re
import sys

from docutils import nodes
from sphinx.ext.napoleon import GoogleDocstring
from sphinx.util.docutils import SphinxDirective

import qsdolfinx

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs"))  # katex.py, subscripts.py

project = "qsdolfinx"
author = "The qsdolfinx developers"
copyright = "The qsdolfinx developers"
version = release = qsdolfinx.__version__
extensions = ["katex", "subscripts", "myst_parser", "sphinx.ext.autodoc"]
extensions += ["sphinx.ext.autosummary", "sphinx.ext.napoleon"]
smartquotes = False  # of --option it would make –option

myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "dollarmath"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    "Array": "Array",
    "Expression": "Expression",
    "Field": "Field",
    "Parameter": "Parameter",
    "Scalar": "Scalar",
    "npt.ArrayLike": "ArrayLike",
    "npt.NDArray": "NDArray",
}
autodoc_default_options = {
    "members": True,
    # All that is inherited, but from these.
    "inherited-members": "object, tuple, int, Enum, IntEnum, BaseException, Law, Friction, Smooth",
}
maximum_signature_line_length = 88
autosummary_generate = True
templates_path = ["templates"]
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = f"qsdolfinx {release}"
html_static_path = ["static"]
html_css_files = ["katex/katex.min.css", "tables.css", "formulas.css", "pages.css"]
html_js_files = ["katex/katex.min.js", "formulas.js"]
html_math_renderer = "katex"
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"


def escape_bars(app, what, name, obj, options, lines):
    """Let |τ| be an absolute value, which reStructuredText takes for a substitution."""
    for i, line in enumerate(lines):
        parts = re.split(r"(``.*?``)", line)
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        lines[i] = "".join(parts)


def parse_as_text(parse):
    """Read properties' docstrings as those of methods: what is before a colon is not a type."""

    def parse_any(docstring):
        if docstring._what in ("attribute", "data", "property"):
            docstring._what = "method"
        parse(docstring)

    return parse_any


class Demo(SphinxDirective):
    """A program of the repository: its docstring as text, then its source."""

    required_arguments = 1

    def run(self):
        """Make the nodes."""
        path = ROOT / self.arguments[0]
        self.env.note_dependency(str(path))
        source = path.read_text(encoding="utf-8")
        module = ast.parse(source)
        text = self.parse_text_to_nodes(ast.get_docstring(module))
        rest = "\n".join(source.split("\n")[module.body[0].end_lineno :]).strip() + "\n"
        name = nodes.paragraph("", "", nodes.literal("", self.arguments[0]))
        code = nodes.literal_block(rest, rest, language="python")
        return [*text, name, code]


def skip_fields(app, what, name, obj, skip, options):
    """Leave out fields of named tuples, which the text of the class lists."""
    return True if type(obj).__name__ == "_tuplegetter" else None


def setup(app):
    """Register what is above."""
    GoogleDocstring._parse = parse_as_text(GoogleDocstring._parse)
    app.add_directive("demo", Demo)
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("autodoc-skip-member", skip_fields)
