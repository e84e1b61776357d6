"""Of S_k in a sentence the site makes an S with a subscript; code and formulas stay as they are."""

import re

from docutils import nodes

#: A single letter, perhaps with an accent, and what is below it: λ_k, ḡ_k, λ̂_h, x_{t+Δt}.
SYMBOL = re.compile(r"(?<![A-Za-z0-9_])([^\W\d_][\u0300-\u036f]?)_(\{[^{}\s]+\}|[^\W_]+)")
LEFT_ALONE = (nodes.literal, nodes.FixedTextElement, nodes.math, nodes.title, nodes.raw)


def split(text):
    """Nodes for a text: what is between symbols, and their letters and subscripts."""
    start = 0
    for symbol in SYMBOL.finditer(text):
        yield nodes.Text(text[start : symbol.end(1)])
        below = symbol[2].strip("{}")
        yield nodes.subscript("", below)
        start = symbol.end()
    yield nodes.Text(text[start:])


def typeset(app, document):
    """Go through a page's text."""
    for text in list(document.findall(nodes.Text)):
        parent, skip = text.parent, False
        while parent is not None and not skip:
            skip = isinstance(parent, LEFT_ALONE)
            parent = parent.parent
        if not skip and SYMBOL.search(text):
            text.parent.replace(text, [node for node in split(text) if node.astext()])


def setup(app):
    """Register what is above."""
    app.connect("doctree-read", typeset)
    return {"parallel_read_safe": True}
