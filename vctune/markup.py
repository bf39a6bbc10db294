"""Show results as HTML tables in notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

Cell = str | float | None


def html_table(caption: str, rows: Iterable[Sequence[Cell]], head: Sequence[str] = ()) -> str:
    """Return a table as HTML. Numbers have six significant digits; a cell that is None is blank."""
    top = f"<thead>{_row(head, 'th')}</thead>" if head else ""
    body = "".join(_row(row, "td") for row in rows)
    return f"<table><caption>{escape(caption)}</caption>{top}<tbody>{body}</tbody></table>"


def html_facts(caption: str, facts: Mapping[str, Cell]) -> str:
    """Return named values as an HTML table with one row for each value that is not None."""
    return html_table(caption, [(name, value) for name, value in facts.items() if value is not None])


def span(band: tuple[float, float] | None) -> str | None:
    """Return a frequency band as text, without its unit; None without a band."""
    return None if band is None else f"{band[0]:.6g} to {band[1]:.6g}"


def _row(cells: Sequence[Cell], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{_text(cell)}</{tag}>' for cell in cells)}</tr>"


def _text(cell: Cell) -> str:
    return "" if cell is None else escape(cell) if isinstance(cell, str) else f"{cell:.6g}"
