"""Configure Sphinx for the site; `python docs/make.py` runs Sphinx over the pages that it lays out."""

from __future__ import annotations

import re
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import mmdr
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util.docutils import SphinxDirective

from vctune.version import __version__

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx

project, author, version = "vctune", "the vctune developers", __version__
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
default_role = "literal"
root_doc = "README"
highlight_language = "none"
suppress_warnings = ["toc.not_included"]  # only links lead to pages of designs
myst_enable_extensions = ["dollarmath", "html_image"]
myst_fence_as_directive = ["mermaid"]
myst_heading_anchors = 4
python_use_unqualified_type_names = True
autodoc_typehints = "none"  # docstrings state the types
napoleon_use_ivar = True
html_theme = "furo"
html_title = f"vctune {__version__}"
html_static_path = [__file__.replace("conf.py", "style.css")]
html_css_files = ["style.css"]
html_math_renderer = "mathml"  # which browsers show without a script from the network
html_show_sourcelink = html_copy_source = False
GROUP = re.compile(r"\w+(?:, \w+)+")  # Names of a group in a docstring


class Mermaid(SphinxDirective):
    """A diagram, drawn when the site is built."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the diagram as an SVG element."""
        drawn = mmdr.render("\n".join(self.content)).svg()
        return [nodes.raw("", f'<div class="diagram">{drawn}</div>', format="html")]


def visit_math(translator: Any, node: Element) -> None:
    """Write a formula as MathML."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    translator.body.append(f'<span class="{display} formula">{convert(node.astext(), display=display)}</span>')
    raise nodes.SkipNode


def one_by_one(_app: Sphinx, _what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Give each name of a group in a docstring, "a, b : float", an entry of its own."""
    for place, line in reversed([*enumerate(lines)]):
        names, _, kind = line.partition(" : ")
        if kind and GROUP.fullmatch(names):
            text = [*takewhile(lambda below: below.startswith(" "), lines[place + 1 :])]
            kinds = kind.split(" and ")
            each = zip(names.split(", "), kinds + kinds[-1:] * names.count(","), strict=False)
            lines[place : place + 1 + len(text)] = [new for name, of in each for new in (f"{name} : {of}", *text)]


def setup(app: Sphinx) -> None:
    """Register the renderers of formulas and diagrams with Sphinx, and read docstrings before napoleon does."""
    app.add_directive("mermaid", Mermaid)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math, None))
    app.connect("autodoc-process-docstring", one_by_one, priority=400)
