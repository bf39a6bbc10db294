"""Configure Sphinx for the site; `python docs/make.py` runs Sphinx over the pages that `layout.py` writes."""

from __future__ import annotations

import re
from pathlib import Path
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
root_doc = "index"
default_role = "literal"

myst_enable_extensions = ["dollarmath", "html_image"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
suppress_warnings = ["toc.not_included"]  # only links lead to pages of sources and designs
highlight_language = "none"

autodoc_preserve_defaults = True
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"vctune {__version__}"
html_static_path = [str(Path(__file__).with_name("style.css"))]
html_css_files = ["style.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False

SECTION = re.compile(r"^[A-Z][a-z]+( [A-Z][a-z]+)*$")
TAKING = ("Parameters", "Attributes", "Other Parameters")
"""Sections of docstrings whose entries have the form `name : description`, without a type; the signature has the
types."""
VERBATIM = re.compile(r"(``?[^`]+``?)")


def visit_inline(translator: Any, node: Element) -> None:
    """Write an inline formula as MathML, which browsers show without a script."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def visit_display(translator: Any, node: Element) -> None:
    """Write a displayed formula as MathML in a box that scrolls."""
    translator.body.append(f'<div class="formula">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def plain_docstring(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Convert the entries of a docstring to the form that napoleon reads, and escape characters that markup would
    interpret."""
    section = ""
    made: list[str] = []
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if SECTION.match(line) and set(below) == {"-"}:
            section = line
        entry = re.match(r"(\S.*?) : (.*)", line) if section in TAKING else None
        if entry:
            made += [entry[1], f"    {_escaped(entry[2])}"]
        else:
            made.append(_escaped(line))
    lines[:] = made


def _escaped(line: str) -> str:
    parts = VERBATIM.split(line)
    return "".join(part if part.startswith("`") else re.sub(r"([|*]|_\b)", r"\\\1", part) for part in parts)


def setup(app: Sphinx) -> None:
    """Register the functions of this module with Sphinx."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_display, None))
    app.connect("autodoc-process-docstring", plain_docstring, priority=400)
