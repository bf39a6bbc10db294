"""The environment of the pages' templates, with its filters for numbers and mathematics."""

from __future__ import annotations

from collections.abc import Callable

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from vctune.report.typography import DIGITS, html, quantity


def templates(put: Callable[[str], str] = lambda text: text) -> Environment:
    """Return Jinja's environment of the pages' templates."""
    folder = PackageLoader("vctune", "report")
    found = Environment(loader=folder, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    found.filters["math"] = lambda text: Markup(html(put(text)))
    found.filters["amount"] = lambda value, unit="", digits=DIGITS: (
        "" if value is None else str(quantity(value, unit, digits))
    )
    return found
