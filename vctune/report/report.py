"""From a design's record to its report: report.html, figures as SVG and PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from vctune.document.files import write_together
from vctune.document.reading import parse_problem
from vctune.model.quantities import Coupling, Gains
from vctune.report.contents import READINGS, REPORT, remove_figures
from vctune.report.experiments import simulation_figure
from vctune.report.figures import Design, figures
from vctune.report.page import figure_files, page, png, svg


def write_report(record: dict[str, Any], folder: Path, simulation: dict[str, Any] | None = None) -> None:
    """Write report.html and the figures of a design, none of an earlier one left; needs nothing but its record.

    Parameters
    ----------
    record : the object of design.json
    folder : for report.html and the figures
    simulation : the object of simulation.json of this design; None without one

    Raises
    ------
    InputError
        If the record's problem cannot be read or the folder cannot be written.
    """
    problem = parse_problem(record["problem"]["text"], record["problem"]["name"], record["problem"]["name"])
    drawn: dict[str, Figure] = {}
    if record["gains"] is not None:
        drawn = figures(Design(problem, Gains(**record["gains"]), Coupling(**record["coupling"]), record))
    if simulation is not None:
        drawn["simulation"] = simulation_figure(simulation)
    vector = {name: svg(figure, name) for name, figure in drawn.items()}
    files: dict[Path, str | bytes | memoryview] = {folder / REPORT: page(record, problem, vector, simulation)}
    files |= {folder / f"{name}.svg": text for name, text in vector.items()}
    files |= {folder / f"{name}.png": png(figure) for name, figure in drawn.items()}
    write_together(files)
    remove_figures(folder, set(READINGS) - set(drawn))  # of an earlier design that had them


def write_simulation(simulation: dict[str, Any], folder: Path) -> None:
    """Write the figure of a simulation alone."""
    write_together(figure_files(simulation_figure(simulation), folder, "simulation"))
