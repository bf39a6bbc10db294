"""Configure Sphinx for the site; `python docs/make.py` runs Sphinx over the pages that it lays out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docutils import nodes
from latex2mathml.converter import convert

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


def visit_math(translator: Any, node: Element) -> None:
    """Write a formula as MathML."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    translator.body.append(f'<span class="{display} formula">{convert(node.astext(), display=display)}</span>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer of formulas with Sphinx."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math, None))
