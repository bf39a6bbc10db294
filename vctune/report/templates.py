"""Pages made of templates: their sentences, figures and files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.environment import TemplateModule
from markupsafe import Markup
from matplotlib.figure import Figure

from vctune.document.records.part import text
from vctune.report.paths import REPORT
from vctune.report.style import DIGITS, INK, PAPER, html, limit, plain, quantity, svg


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure of a page and its texts."""

    name: str  # of its file
    title: str
    finding: str  # sentence with the numbers that the figure shows; "" without any
    reading: str  # what is drawn, and how it should look
    figure: Figure


def page_files(
    folder: Path, template: str, shown: Sequence[Shown], put: Callable[[str], str] = lambda text: text, **values: Any
) -> dict[Path, str]:
    """Return the figures of a page as SVG files, then the page itself; `put` changes its sentences."""
    pictures = {each.name: svg(each.figure, each.name) for each in shown}
    said = {each.name: put(f"{each.title}. {each.finding}".strip()) for each in shown}
    figures = [(each, _inline(pictures[each.name], each.name, said[each.name])) for each in shown]
    page = _templates(put).get_template(template).render(figures=figures, **values)
    return {**{folder / f"{name}.svg": text for name, text in pictures.items()}, folder / REPORT: page}


def words(name: str, *of: Any) -> str:
    """Return a sentence of words.txt.j2 about something, by its name."""
    made = getattr(_sentences(), name)(*of)
    return re.sub(r"[ \n]+", " ", made).strip()  # a thin space stays


@cache
def _sentences() -> TemplateModule:
    """Return words.txt.j2, compiled once."""
    return _templates().get_template("words.txt.j2").module


def _templates(put: Callable[[str], str] = lambda text: text) -> Environment:
    """Return Jinja's environment of the pages, with its filters for numbers and mathematics."""
    escaped = select_autoescape(("html.j2",))
    found = Environment(
        loader=PackageLoader("vctune", "report"), autoescape=escaped, undefined=StrictUndefined, trim_blocks=True
    )
    found.filters |= {
        "math": lambda text: Markup(html(put(text))),
        "amount": lambda value, unit="", digits=DIGITS: "" if value is None else str(quantity(value, unit, digits)),
        "css": _css_string,
        "limit": limit,
        "plain": text,
    }
    return found


def _css_string(text: str) -> Markup:
    """Return a text as a quoted string of CSS, in which no character of the text can end the string or the style
    element."""
    return Markup('"' + re.sub(r'[\\"<>&\n\r]', lambda special: f"\\{ord(special[0]):x} ", text) + '"')


def _inline(text: str, name: str, said: str) -> Markup:
    """Return an SVG file as an element of a page, whose identifiers no other figure of the page has."""
    text = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", text[text.index("<svg") :])
    text = text.replace("<svg ", f'<svg role="img" aria-label="{escape(plain(said))}" ', 1).replace(
        "xlink:href", "href"
    )
    return Markup(text.replace(INK, "currentColor").replace(PAPER, "none"))
