"""Write the report of a design from its record: report.html and its figures as SVG."""

from __future__ import annotations

from pathlib import Path

from vctune.analysis.in_hands import RatioInAnyHand, RatioInHand, least_ratios
from vctune.document.reading import parse_problem
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.simulation_json import SimulationRecord
from vctune.document.text.output_files import write_together
from vctune.report.figures.design_figures import Design, figures
from vctune.report.figures.experiment_figures import simulation_figure
from vctune.report.page.contents import REPORT, report_paths
from vctune.report.page.page import design_page
from vctune.report.page.sliders import overlays
from vctune.report.svg.drawing import Drawing


def write_report(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> None:
    """Write report.html and the figures of a design from only its record. Delete the figures of an earlier design."""
    files = report_files(record, folder, simulation)
    write_together(files, [path for path in report_paths(folder) if path not in files])


def report_files(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> dict[Path, str]:
    """Return the files of `write_report`. The page is the last one."""
    problem = parse_problem(record.problem.text, record.problem.name, record.problem.name)
    drawn: dict[str, Drawing] = {}
    least: list[RatioInHand | RatioInAnyHand] = []
    if record.design is not None:
        least = least_ratios(problem, *record.design)
        drawn = figures(Design(problem, *record.design, record, least))
    if simulation is not None:
        drawn["simulation"] = simulation_figure(simulation)
    pictures = {name: drawing.svg(name) for name, drawing in drawn.items()}
    files = {folder / f"{name}.svg": text for name, text in pictures.items()}
    return {**files, folder / REPORT: design_page(record, problem, pictures, overlays(drawn), simulation, least)}


def simulation_files(simulation: SimulationRecord, folder: Path) -> dict[Path, str]:
    """Return only the figure of a simulation."""
    return {folder / "simulation.svg": simulation_figure(simulation).svg("simulation")}
