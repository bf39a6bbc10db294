"""The page of a design: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import re
from pathlib import Path

from matplotlib import rc_context

from vctune.document.reading import parse_problem
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.simulation_json import SimulationRecord
from vctune.document.text.output_files import write_together
from vctune.proof.claims.registry import CLAIMS
from vctune.report.curves import requirements
from vctune.report.design_figures import IN_WORDS, design_figures
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.report.paths import report_paths
from vctune.report.simulation_figure import simulation_figure
from vctune.report.style import STYLE, svg
from vctune.report.tables import asked, dynamics, found
from vctune.report.templates import page_files
from vctune.report.verdict import limits, summary


def write_report(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> None:
    """Write report.html and the figures of a design from only its record. Delete the figures of an earlier design."""
    files = report_files(record, folder, simulation)
    write_together(files, [path for path in report_paths(folder) if path not in files])


def report_files(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> dict[Path, str]:
    """Return the files of `write_report`. The page is the last one."""
    problem = parse_problem(record.problem.text, record.problem.name, record.problem.name)
    required = requirements(problem, *record.design) if record.design is not None else []
    head = summary(record, problem)
    shown = design_figures(problem, record, required, head.doubt)
    if simulation is not None:
        with rc_context(STYLE):
            shown.append(simulation_figure(simulation))

    def put(text: str) -> str:
        text = problem.units.translated(text)
        for key in ("safety_factor", "max_sensitivity"):  # words for the problem's numbers
            text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(problem.stability, key):g}", text)
        return text

    groups, proof = record.groups(), record.certificate
    return page_files(
        folder,
        "page.html.j2",
        shown,
        put,
        record=record,
        problem=problem,
        summary=head,
        asked=asked(problem),
        chosen=[row for title in ("gains", "coupling") for row in groups.get(title, [])],
        terms=IN_WORDS,
        limits=limits(record),
        labels=CLAIMS,
        claims=[(claim, *found(claim.id, record, problem, required)) for claim in (proof.claims if proof else [])],
        dynamics=dynamics(problem.device),
        bounded=[key.rpartition(".")[2] for key in record.at_bound],
        groups=groups,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
    )


def simulation_files(simulation: SimulationRecord, folder: Path) -> dict[Path, str]:
    """Return only the figure of a simulation."""
    with rc_context(STYLE):
        shown = simulation_figure(simulation)
    return {folder / f"{shown.name}.svg": svg(shown.figure, shown.name)}
