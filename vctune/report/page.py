"""The page: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import json
import re
from io import BytesIO
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib import rc_context
from matplotlib.figure import Figure

from vctune.document.record import DesignRecord
from vctune.model.problem import Problem
from vctune.report.contents import READINGS
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.report.style import INK, PAPER


def page(
    record: DesignRecord, problem: Problem, drawn: dict[str, str], simulation: dict[str, Any] | None = None
) -> str:
    """Return the HTML of a design.

    Parameters
    ----------
    record : of the design, which the page embeds as the object of design.json
    problem : the problem that the record's text states
    drawn : figures as SVG, by name
    simulation : the object of simulation.json, if there is one
    """
    environment = Environment(
        loader=PackageLoader("vctune", "report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    shown = [
        {"title": READINGS[name][0], "reading": READINGS[name][1], "svg": inline(text)} for name, text in drawn.items()
    ]
    embedded = json.dumps(record.to_json(), indent=1, allow_nan=False).replace("<", "\\u003c")
    template = environment.get_template("page.html.j2")
    return template.render(
        record=record,
        problem=problem,
        figures=shown,
        groups=record.groups(),
        embedded=embedded,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
    )


def inline(text: str) -> str:
    """Return an SVG file as an element that takes its ink from the page's text colour and lets its ground through."""
    text = re.sub(r"^.*?(?=<svg)", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return text.replace(INK, "currentColor").replace(PAPER, "none")


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG: the same bytes for the same figure, places to a hundredth of a point, no idle names."""
    stream = BytesIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    text = re.sub(r"\n +", "\n", stream.getvalue().decode())
    for long, short in ((r"font-family: [^;\"]*", "font-family: sans-serif"), (r'<g id="[^"]*">', "<g>")):
        text = re.sub(long, short, text)
    return re.sub(r'(?<=[ \n])(d|x|y|transform)="[^"]*"', _rounded, text)


def _rounded(attribute: re.Match[str]) -> str:
    return re.sub(r"-?\d+\.\d{3,}(e-?\d+)?", lambda number: f"{float(number[0]):.2f}", attribute[0])


def figure_file(figure: Figure, folder: Path, stem: str) -> dict[Path, str]:
    """Return a figure as an SVG file."""
    return {folder / f"{stem}.svg": svg(figure, stem)}
