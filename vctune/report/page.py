"""The page of a design: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from pathlib import Path

from matplotlib import rc_context

from vctune.document.reading import parse_problem
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.simulation_json import SimulationRecord
from vctune.document.text.output_files import write_together
from vctune.model.problem import Problem
from vctune.report.design_figures import IN_WORDS, Shown, design_figures
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.report.paths import REPORT, report_paths
from vctune.report.simulation_figure import simulation_figure
from vctune.report.style import INK, PAPER, STYLE, svg
from vctune.report.tables import asked, claim_lines, dynamics
from vctune.report.typography import plain, quantity, templates
from vctune.report.verdict import doubt, limits, summary


def write_report(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> None:
    """Write report.html and the figures of a design from only its record. Delete the figures of an earlier design."""
    files = report_files(record, folder, simulation)
    write_together(files, [path for path in report_paths(folder) if path not in files])


def report_files(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> dict[Path, str]:
    """Return the files of `write_report`. The page is the last one."""
    problem = parse_problem(record.problem.text, record.problem.name, record.problem.name)
    shown = design_figures(problem, record, doubt(record, problem))
    if simulation is not None:
        with rc_context(STYLE):
            shown.append(simulation_figure(simulation))
    pictures = {each.name: svg(each.figure, each.name) for each in shown}
    page = _design_page(record, problem, figure_entries(shown, pictures), simulation)
    return {**{folder / f"{name}.svg": text for name, text in pictures.items()}, folder / REPORT: page}


def simulation_files(simulation: SimulationRecord, folder: Path) -> dict[Path, str]:
    """Return only the figure of a simulation."""
    with rc_context(STYLE):
        shown = simulation_figure(simulation)
    return {folder / f"{shown.name}.svg": svg(shown.figure, shown.name)}


def figure_entries(shown: Sequence[Shown], pictures: dict[str, str]) -> list[dict[str, str]]:
    """Return name, title, finding, reading and SVG element of each figure."""
    return [
        {"name": each.name, "title": each.title, "finding": each.finding, "reading": each.reading}
        | {"svg": _inline(pictures[each.name], f"{each.title}. {each.finding}".strip(), each.name)}
        for each in shown
    ]


def _design_page(
    record: DesignRecord, problem: Problem, figures: list[dict[str, str]], simulation: SimulationRecord | None
) -> str:
    """Return the HTML of the page about a design, or about the reason why a problem has no design."""
    head, groups = summary(record, problem), record.groups()
    date = f"{record.date} · " if record.date else ""

    def put(text: str) -> str:
        text = problem.units.translated(text)
        for key in ("safety_factor", "max_sensitivity"):  # words for the problem's numbers
            text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(problem.stability, key):g}", text)
        return text

    return (
        templates(put)
        .get_template("page.html.j2")
        .render(
            record=record,
            problem=problem,
            summary=head,
            sheet=[
                _css_string(f"{record.problem.name}: {head.word}"),
                _css_string(f"{date}problem {record.problem.sha256[:16]} · "),
            ],
            asked=asked(problem),
            chosen=[row for title in ("gains", "coupling") for row in groups.get(title, [])],
            terms=_error_terms(record),
            limits=limits(record),
            claims=claim_lines(record, problem),
            dynamics=dynamics(problem.device),
            figures=figures,
            bounded=[key.rpartition(".")[2] for key in record.at_bound],
            groups=groups,
            measured=measured_rows(simulation) if simulation else [],
            headings=HEADINGS,
        )
    )


def _error_terms(record: DesignRecord) -> list[tuple[str, str, str]]:
    """Return words, formula and value of the error and of each of its terms."""
    terms = record.transparency
    if terms is None:
        return []
    shown = {row.label for row in terms.rows(record.units)}
    found = [("all together", "error", terms.error)]
    found += [(said, terms.labels[term], getattr(terms, term)) for term, said in IN_WORDS.items()]
    return [(said, label, str(quantity(size, digits=3))) for said, label, size in found if label in {*shown, "error"}]


def _css_string(text: str) -> str:
    """Return a text as a quoted string of CSS, in which no character of the text can end the string or the style
    element."""
    return '"' + re.sub(r'[\\"<>&\n\r]', lambda special: f"\\{ord(special[0]):x} ", text) + '"'


def _inline(text: str, description: str, name: str) -> str:
    """Return the content of an SVG file as an element of a page, whose identifiers no other figure of the page has."""
    text = re.sub(r"^.*?(?=<svg)", "", text, flags=re.DOTALL)
    text = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", text)
    text = text.replace("<svg ", f'<svg role="img" aria-label="{escape(plain(description))}" ', 1)
    return text.replace("xlink:href", "href").replace(INK, "currentColor").replace(PAPER, "none")
