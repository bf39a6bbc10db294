"""The page: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from typing import Any

from vctune.analysis.in_hands import RatioInAnyHand, RatioInHand
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.part import Row
from vctune.document.records.simulation_json import SimulationRecord
from vctune.model.problem import Problem
from vctune.report.figures.experiment_figures import HEADINGS, dwell_line, measured_rows, simulation_finding
from vctune.report.page.changing_lines import changing_lines
from vctune.report.page.contents import IN_WORDS, READINGS, reading
from vctune.report.page.findings import findings, limits
from vctune.report.page.phase_table import phase_table
from vctune.report.page.sliders import sliders
from vctune.report.page.summary import summary
from vctune.report.page.tables import asked, assumptions, claim_lines, feel_lines
from vctune.report.page.templates import templates
from vctune.report.svg.elements import INK, PAPER
from vctune.report.typography import plain, quantity


def page(
    record: DesignRecord,
    problem: Problem,
    drawn: dict[str, str],
    places: dict[str, list[dict[str, Any]]],
    simulation: SimulationRecord | None = None,
    least: Sequence[RatioInHand | RatioInAnyHand] = (),
) -> str:
    """Return the HTML of a design.

    Parameters
    ----------
    record : record of the design, which the page embeds as the object of design.json
    problem : the problem that the record's text states
    drawn : figures as SVG, by name; the names are keys of `READINGS`
    places : for each figure with sliders, the position of each panel in which the script draws tried curves
        (`vctune.report.page.sliders.overlays`)
    simulation : simulation of this design, if there is one
    least : the least Re Z_c / R in each of the problem's hands; empty without a design
    """
    head, slider_data = summary(record, problem), None
    if record.design is not None:
        shipped = {"kind": head.kind, "word": head.word}
        slider_data = sliders(problem, *record.design, record, least)
        slider_data |= {"overlays": places, "shipped": shipped}
    environment = templates(lambda text: _with_limits(problem.units.translated(text), problem))
    groups = record.groups()
    return environment.get_template("page.html.j2").render(
        record=record,
        problem=problem,
        summary=head,
        sheet=[_css_text(f"{record.problem.name}: {head.word}"), _css_text(_sheet_heading(record))],
        asked=asked(problem),
        chosen=[row for title in ("gains", "coupling") for row in groups.get(title, [])],
        terms=_error_terms(record),
        limits=limits(record),
        claims=claim_lines(record, problem),
        assumptions=[*assumptions(problem), *changing_lines(record, problem)],
        feel=feel_lines(problem, *record.design) if record.design is not None else [],
        figures=_figure_rows(record, problem, drawn, simulation),
        bounded=[key.rpartition(".")[2] for key in record.at_bound],
        groups=groups,
        phases=phase_table(problem, record.design[0]) if record.design is not None else None,
        embedded=_embedded(record.to_json()),
        sliders=_embedded(slider_data) if slider_data is not None else None,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
        dwell=dwell_line(simulation) if simulation else "",
        translated=problem.units.translated,
    )


def _figure_rows(
    record: DesignRecord, problem: Problem, drawn: dict[str, str], simulation: SimulationRecord | None
) -> list[dict[str, str]]:
    """Return name, title, finding, reading and SVG of each figure."""
    translated, found = problem.units.translated, findings(record, problem)
    found |= {"simulation": simulation_finding(simulation)} if simulation is not None else {}
    figures = []
    for name, text in drawn.items():
        title, finding = translated(READINGS[name][0]), translated(found.get(name, ""))
        read = reading(name, problem.device.display, problem.worlds)
        description = f"{title}. {_with_limits(finding, problem)}".strip()
        texts = {"title": title, "finding": finding, "reading": translated(read)}
        figures.append({"name": name, **texts, "svg": inline(text, description)})
    return figures


def _with_limits(text: str, problem: Problem) -> str:
    """Return a text in which their values replace the names `safety_factor` and `max_sensitivity`."""
    for key in ("safety_factor", "max_sensitivity"):
        text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(problem.stability, key):g}", text)
    return text


def _error_terms(record: DesignRecord) -> list[Row]:
    """Return the terms of the error in words, with few digits."""
    terms = record.transparency
    if terms is None:
        return []
    rows = {row.label: row for row in terms.rows(record.units)}
    named = {"admittance": terms.admittance_label, "tracking": terms.tracking_label, "coupling": terms.coupling_label}
    return [
        Row(name, str(quantity(getattr(terms, term), digits=3)), IN_WORDS[term])
        for term, name in named.items()
        if name in rows
    ]


def _sheet_heading(record: DesignRecord) -> str:
    """Return the text in the head of each printed sheet: date and digest of the problem file."""
    date = f"{record.date} · " if record.date else ""
    return f"{date}problem {record.problem.sha256[:16]} · "


def _css_text(text: str) -> str:
    """Return a text as a string of CSS. The text can end neither the string nor the style element."""
    return '"' + re.sub(r'[\\"<>&\n\r]', lambda found: f"\\{ord(found[0]):x} ", text) + '"'


def _embedded(data: dict[str, Any]) -> str:
    """Return data as JSON in which no text can end the script element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def inline(svg: str, description: str) -> str:
    """Return an SVG file as an element. It uses the page's text colour and has a transparent background.

    Parameters
    ----------
    svg : content of the file
    description : description of the figure in words
    """
    svg = re.sub(r"^.*?(?=<svg)", "", svg, flags=re.DOTALL)
    svg = svg.replace("<svg ", f'<svg role="img" aria-label="{escape(plain(description))}" ', 1)
    return svg.replace("xlink:href", "href").replace(INK, "currentColor").replace(PAPER, "none")
