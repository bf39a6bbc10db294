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
from vctune.report.figures.experiment_figures import HEADINGS, measured_rows, simulation_finding
from vctune.report.page.contents import IN_WORDS, READINGS, reading
from vctune.report.page.findings import findings, limits
from vctune.report.page.phase_table import phase_table
from vctune.report.page.sliders import sliders
from vctune.report.page.summary import summary
from vctune.report.page.tables import asked, assumptions, claim_lines, feel_lines
from vctune.report.page.templates import templates
from vctune.report.svg.elements import INK, PAPER
from vctune.report.typography import plain, quantity


def design_page(
    record: DesignRecord,
    problem: Problem,
    svg_files: dict[str, str],
    overlays: dict[str, list[dict[str, Any]]],
    simulation: SimulationRecord | None = None,
    least_ratios: Sequence[RatioInHand | RatioInAnyHand] = (),
) -> str:
    """Return the HTML of the page about a design, or about the reason why a problem has no design."""
    first_screen, slider_data = summary(record, problem), None
    if record.design is not None:
        shipped = {"kind": first_screen.kind, "word": first_screen.word}
        slider_data = sliders(problem, *record.design, record, least_ratios)
        slider_data |= {"overlays": overlays, "shipped": shipped}
    jinja = templates(lambda text: _with_stated_numbers(problem.units.translated(text), problem))
    groups = record.groups()
    return jinja.get_template("page.html.j2").render(
        record=record,
        problem=problem,
        summary=first_screen,
        sheet=[_css_string(f"{record.problem.name}: {first_screen.word}"), _css_string(_date_and_digest(record))],
        asked=asked(problem),
        chosen=[row for title in ("gains", "coupling") for row in groups.get(title, [])],
        terms=_error_terms(record),
        limits=limits(record),
        claims=claim_lines(record, problem),
        assumptions=assumptions(problem),
        feel=feel_lines(problem, *record.design) if record.design is not None else [],
        figures=_figure_entries(record, problem, svg_files, simulation),
        bounded=[key.rpartition(".")[2] for key in record.at_bound],
        groups=groups,
        phases=phase_table(problem, record.design[0]) if record.design is not None else None,
        embedded=_script_json(record.to_json()),
        sliders=_script_json(slider_data) if slider_data is not None else None,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
        translated=problem.units.translated,
    )


def _figure_entries(
    record: DesignRecord, problem: Problem, svg_files: dict[str, str], simulation: SimulationRecord | None
) -> list[dict[str, str]]:
    """Return name, title, finding, reading and SVG element of each figure; the finding is "" if there is none."""
    translated, found = problem.units.translated, findings(record, problem)
    found |= {"simulation": simulation_finding(simulation)} if simulation is not None else {}
    entries = []
    for name, svg in svg_files.items():
        title, finding = translated(READINGS[name][0]), translated(found.get(name, ""))
        how_to_read = reading(name, problem.device.display, problem.worlds)
        description = f"{title}. {_with_stated_numbers(finding, problem)}".strip()
        texts = {"title": title, "finding": finding, "reading": translated(how_to_read)}
        entries.append({"name": name, **texts, "svg": inline_svg(svg, description)})
    return entries


def _with_stated_numbers(text: str, problem: Problem) -> str:
    """Return a text with the problem's numbers in place of the words `safety_factor` and `max_sensitivity`."""
    for key in ("safety_factor", "max_sensitivity"):
        text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(problem.stability, key):g}", text)
    return text


def _error_terms(record: DesignRecord) -> list[Row]:
    """Return a row for each term of the error: its formula, its value with few digits, and its words in place of the
    unit."""
    terms = record.transparency
    if terms is None:
        return []
    shown = {row.label: row for row in terms.rows(record.units)}
    label_of = {
        "admittance": terms.admittance_label,
        "tracking": terms.tracking_label,
        "coupling": terms.coupling_label,
    }
    return [
        Row(label, str(quantity(getattr(terms, term), digits=3)), IN_WORDS[term])
        for term, label in label_of.items()
        if label in shown
    ]


def _date_and_digest(record: DesignRecord) -> str:
    """Return date and digest of the problem file, which stand before the number at the top of each printed sheet."""
    date = f"{record.date} · " if record.date else ""
    return f"{date}problem {record.problem.sha256[:16]} · "


def _css_string(text: str) -> str:
    """Return a text as a quoted string of CSS, in which no character of the text can end the string or the style
    element."""
    return '"' + re.sub(r'[\\"<>&\n\r]', lambda special: f"\\{ord(special[0]):x} ", text) + '"'


def _script_json(data: dict[str, Any]) -> str:
    """Return data as JSON for a script element, in which no text can end that element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def inline_svg(svg: str, description: str) -> str:
    """Return the content of an SVG file as an element for an HTML page."""
    svg = re.sub(r"^.*?(?=<svg)", "", svg, flags=re.DOTALL)
    svg = svg.replace("<svg ", f'<svg role="img" aria-label="{escape(plain(description))}" ', 1)
    return svg.replace("xlink:href", "href").replace(INK, "currentColor").replace(PAPER, "none")
