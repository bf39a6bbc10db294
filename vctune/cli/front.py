"""`vctune front`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.sweep import worker_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune.document.study import Study
    from vctune.study.executors import Crew
    from vctune.study.table import Table


@click.command(short_help="Draw the two trade-offs that a designer asks about.")
@click.argument("problem", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder for OUT/NAME/front/.",
)
@worker_options
def front(problem: Path, out: Path, jobs: int | None, executor: str) -> int:
    """Find the Pareto fronts of PROBLEM: between the three terms of the error, and of error against band.

    Two sweeps with a name: K_p over its range with the coupling's weight over six decades, and the stability band's
    upper edge up to the Nyquist frequency. OUT/NAME/front/ then holds terms.csv and band.csv with their pictures; an
    interrupted run goes on.
    """
    from math import pi

    from vctune.cli.output import emit
    from vctune.document import toml
    from vctune.document.errors import InputError, Mistake, printable
    from vctune.document.files import folder_name, make_folder, write_together
    from vctune.document.reading import read_problem

    file = read_problem(problem)
    if file.problem.bounds.fixed:
        raise InputError(str(problem), [Mistake("", "fixes every number: there is nothing to trade; free one")])
    document, folder = toml.parse(file.text, str(problem)), out / folder_name(file.problem.name) / "front"

    from vctune.exits import ExitCode
    from vctune.study.executors import available_cores, crew_of
    from vctune.study.front import band_front, band_study, terms_front, terms_study
    from vctune.study.table import table_files

    with crew_of(executor, jobs or available_cores()) as crew:
        make_folder(folder)
        terms = _solved(terms_study(document, file.problem), terms_front, folder, crew)
        band = _solved(band_study(document, file.problem), band_front, folder, crew)
    from vctune.report.page import figure_file
    from vctune.report.sweep import band_figure, terms_figure

    edge = file.problem.transparency.band.max / (2 * pi)
    tables = table_files(terms, folder, "terms") | table_files(band, folder, "band")
    pictures = figure_file(terms_figure(terms), folder, "terms") | figure_file(band_figure(band, edge), folder, "band")
    write_together({**tables, **pictures})
    emit(f"{printable(file.problem.name)}: {len(terms.status)} designs on the front of the three terms,")
    emit(f"{len(band.status)} on the front of error against band; written to {folder}")
    return ExitCode.OK if terms.status and band.status else ExitCode.FAILED


def _solved(study: Study, front_of: Callable[[Table], Table], folder: Path, crew: Crew) -> Table:
    """Return the front of a study, swept."""
    from vctune.cli.progress import bar_on_stderr
    from vctune.study.rows import open_rows
    from vctune.study.sweep import sweep
    from vctune.study.table import table_of

    with open_rows(folder / f"{study.name}.rows.jsonl", study, restart=False) as rows:
        with bar_on_stderr(f"vctune front: {study.name}", study.count) as tick:
            keys = sweep(study, rows, crew, tick)
        return front_of(table_of(study, rows, keys))
