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

from vctune.document.records.design_json import DesignRecord
from vctune.document.records.simulation_json import SimulationRecord
from vctune.model.problem import Problem
from vctune.report.figures.experiment_figures import HEADINGS, dwell_line, measured_rows
from vctune.report.figures.style import INK, PAPER
from vctune.report.page.contents import READINGS, reading
from vctune.report.page.phase_table import phase_table
from vctune.report.page.sliders import sliders
from vctune.report.page.summary import summary
from vctune.report.page.tables import asked, assumptions, claim_lines, feel_lines
from vctune.running import check_time

IDLE = {
    r"<metadata>.*?</metadata>\n": "",
    r"font-family: [^;\"]*": "font-family: sans-serif",
    r'<g id="[^"]*">': "<g>",
    r' transform="rotate\(-0 [^"]*\)"': "",
}
"""Superfluous text in Matplotlib's SVG files, and its replacement."""


def page(
    record: DesignRecord,
    problem: Problem,
    drawn: dict[str, str],
    places: dict[str, list[dict[str, Any]]],
    simulation: SimulationRecord | None = None,
) -> str:
    """Return the HTML of a design.

    Parameters
    ----------
    record : record of the design, which the page embeds as the object of design.json
    problem : the problem that the record's text states
    drawn : figures as SVG, by name
    places : places of the axes in which tried curves are drawn (`vctune.report.page.sliders.overlays`)
    simulation : simulation of this design, if there is one
    """
    translated, display = problem.units.translated, problem.device.display
    shown = [
        {"name": name, "title": READINGS[name][0], "reading": translated(reading(name, display)), "svg": inline(text)}
        for name, text in drawn.items()
    ]
    seen, tried = summary(record, problem), None
    if record.design is not None:
        shipped = {"kind": seen.kind, "word": seen.word}
        tried = sliders(problem, record.design[0], record.design[1], record)
        tried |= {"overlays": places, "shipped": shipped}
    template = templates().get_template("page.html.j2")
    return template.render(
        record=record,
        problem=problem,
        summary=seen,
        asked=asked(problem),
        claims=claim_lines(record, problem),
        assumptions=assumptions(problem),
        feel=feel_lines(problem, *record.design) if record.design is not None else [],
        loop=next((each for each in shown if each["name"] == "loop"), None),
        figures=[each for each in shown if each["name"] != "loop"],
        groups=record.groups(),
        phases=phase_table(problem, record.design[0]) if record.design is not None else None,
        embedded=_embedded(record.to_json(), indent=1),
        sliders=_embedded(tried) if tried is not None else None,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
        dwell=dwell_line(simulation) if simulation else "",
        translated=translated,
    )


def _embedded(data: dict[str, Any], indent: int | None = None) -> str:
    """Return data as JSON that no text in it can end."""
    return json.dumps(data, indent=indent, allow_nan=False, separators=None if indent else (",", ":")).replace(
        "<", "\\u003c"
    )


def templates() -> Environment:
    """Return the folder of the pages' templates."""
    return Environment(
        loader=PackageLoader("vctune", "report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


def inline(text: str) -> str:
    """Return an SVG file as an element that takes its ink from the page's text colour and lets its ground through."""
    text = re.sub(r"^.*?(?=<svg)", "", text, flags=re.DOTALL)
    return text.replace(INK, "currentColor").replace(PAPER, "none")


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG: the same bytes for the same figure, places to a hundredth of a point, no idle names.

    Parameters
    ----------
    figure : drawn
    name : salt of the identifiers in the file, so that figures of several names go on one page
    """
    check_time()
    stream = BytesIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    text = re.sub(r"\n +", "\n", stream.getvalue().decode())
    for long, short in IDLE.items():
        text = re.sub(long, short, text, flags=re.DOTALL)
    return re.sub(r'(?<=[ \n])(d|x|y|transform)="[^"]*"', _shortened, text)


def _shortened(attribute: re.Match[str]) -> str:
    """Return an attribute with its places to a hundredth and the letter of a run of lines said once."""
    text = re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda number: _hundredths(float(number[0])), attribute[0])
    text = text.replace(" \n", "\n")
    return re.sub(r"[ML] [^A-Za-z\"]+(L [^A-Za-z\"]+)+", lambda run: run[0][0] + run[0][1:].replace("L ", ""), text)


def _hundredths(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def figure_file(figure: Figure, folder: Path, stem: str) -> dict[Path, str]:
    """Return a figure as an SVG file.

    Parameters
    ----------
    figure : drawn
    folder : folder for the file
    stem : stem of its name

    Returns
    -------
    dict
        The file's text by its path.
    """
    return {folder / f"{stem}.svg": svg(figure, stem)}
