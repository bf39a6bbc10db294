"""Provide `vctune sweep` as a function."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, get_args

from vctune.api.result import Files, Printed, write
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.records.part import text
from vctune.document.study_file import Study, build_study
from vctune.document.study_file import read_study as read_study
from vctune.document.text.errors import InputError, has_code, printable
from vctune.document.text.output_files import make_folder
from vctune.exit_codes import ExitCode
from vctune.report.paths import FigureKind
from vctune.study.executors import available_cores, worker_pool
from vctune.study.rows import open_rows
from vctune.study.study_table import Summary, Table, csv_text, number_columns, summary, table_of
from vctune.study.sweep import OnDone
from vctune.study.sweep import sweep as run

ROWS, TABLE = "rows.jsonl", "table.csv"


@dataclass(frozen=True, slots=True)
class Swept:
    """The result of a sweep."""

    study: Study  # the solved study
    table: Table  # one row for each point, with the columns of study/README.md
    dropped: int  # number of incomplete lines from an interrupted earlier run, whose points the sweep solved again
    plot: str = "error"  # column of the table that the picture shows
    figures: FigureKind = "svg"  # kind of file of the picture

    @property
    def cut(self) -> int:
        """Number of points that the time limit cut short."""
        return sum(has_code(reason, "time-limit") for reason in self.table.reason)

    @property
    def summary(self) -> Summary:
        """Counts by status, the yardstick, the best and the worst design, and the corner without designs."""
        return summary(self.study, self.table)

    @property
    def exit_code(self) -> ExitCode:
        """Failed if a point failed or no design is certified; undecided if a point reached the time limit."""
        found = self.summary
        if found.status.get("failed") or not (found.best or self.cut):
            return ExitCode.FAILED
        return ExitCode.UNDECIDED if self.cut else ExitCode.OK

    def rows(self) -> Printed:
        """Yield counts by status, the best and the worst design, the yardstick, and the corner without designs."""
        found = self.summary
        of_them = {"certified": f" ({found.idle} idle)" if found.idle else ""}
        counts = ", ".join(f"{count} {status}{of_them.get(status, '')}" for status, count in found.status.items())
        yield (printable(found.study), "bold"), f": {found.points} points, {counts}"
        for label, row in (("best", found.best), ("worst", found.worst)):
            if row:  # only the keys of axes contain a dot
                axes = ", ".join(f"{key} = {text(value, 6)}" for key, value in row.items() if "." in key)
                idle = ", idle" if row["idle"] else ""
                moving = row["kicks_moving"]
                buzzes = f", buzzes after {moving:.0%} of its kicks" if moving else ""
                yield (f"{label:<5}  error {text(row['error'])} at {axes}{idle}{buzzes}",)
        on, unit = found.yardstick, found.units["reference_impedance"]
        shared = f"over   {text(on['band_hz'])} Hz with Z_0 = {text(on['reference_impedance'])} {unit}"
        varied = f"except {', '.join(on['varied'])}: errors at different values of it are not comparable"
        yield (f"{shared}, {varied if on['varied'] else 'at every point'}",)
        if (corner := found.corner) is not None:
            ends = zip(corner["low"].items(), corner["high"].values(), strict=True)
            spans = ", ".join(f"{key} from {text(low, 6)} to {text(high, 6)}" for (key, low), high in ends)
            yield (f"none   at {corner['points']} points, {corner['share']:.0%} of those with {spans}",)
            yield (f"       most often: {printable(corner['reason'])}",)

    def files(self, folder: Path) -> Files:
        """Return the table of the sweep and, for one or two axes, its picture."""
        from vctune.report.style import picture
        from vctune.report.sweep_figure import sweep_figure

        figure = sweep_figure(self.table, self.plot, grid=self.study.sample.kind == "grid")
        drawn = picture(figure, self.plot, self.figures) if figure else None
        return {folder / TABLE: csv_text(self.table), folder / f"{self.plot}.{self.figures}": drawn}

    def __repr__(self) -> str:
        return f"Swept({self.table!r})"


def sweep(
    problem: ProblemSource | Study,
    axes: Mapping[str, Any] | None = None,
    *,
    sample: Mapping[str, Any] | None = None,
    folder: str | Path | None = None,
    jobs: int | None = None,
    executor: str = "serial",
    restart: bool = False,
    time_limit: float = inf,
    plot: str = "error",
    figures: FigureKind = "svg",
    on_done: OnDone = lambda known: None,
) -> Swept:
    """Solve a problem at many points.

    Parameters
    ----------
    problem : ProblemSource or Study
        Path of a problem file, its tables as a dict, or the problem; without `axes` the path of a study file.
    axes : Mapping[str, Any], optional
        Values by dotted key of the problem: a list or an array, `{"linear": [a, b], "n": n}` or `{"log": [a,
        b], "n": n}`, in the units of the problem file.
    sample : Mapping[str, Any], optional
        `{"kind": "grid"}`, every combination, the default; or `{"kind": "list"}`, the axes' lists element by element.
    folder : str or Path, optional
        Folder for rows, table and picture, in which an interrupted sweep continues; None to write nothing.
    jobs : int, optional
        Number of workers; None for the number of cores; not used by "serial" and "dask:ADDRESS".
    executor : str
        "serial" to work only in this process; "processes" for worker processes, which a script may start only
        under `if __name__ == "__main__":`; or "dask" or "dask:ADDRESS".
    restart : bool
        Whether to begin again instead of resuming.
    time_limit : float
        Seconds for each point; the row of a point that takes longer is undecided.
    plot : str
        Column of the table that the picture shows over one or two axes.
    figures : {"svg", "pdf", "png"}
        Kind of file of the picture.
    on_done : OnDone
        Function that is called after each point with the results so far, in words.

    Returns
    -------
    Swept
        `table.columns()` contains an array for each column, `table.rows()` a dict for each point.

    Raises
    ------
    InputError
        If the problem or the study is invalid, if the folder cannot be written or contains the rows of another study,
        or if there is no such executor or its workers cannot be reached.
    """
    study = _study(problem, axes, sample)
    if plot not in (columns := number_columns(study)):
        message = f"{plot!r} is no column of numbers of this study; one of {', '.join(columns)}"
        raise InputError.of("plot", "bad-option", message)
    if figures not in get_args(FigureKind):
        raise InputError.of("figures", "bad-option", f"is {figures!r}; one of {', '.join(get_args(FigureKind))}")
    with ExitStack() as opened:
        pool = opened.enter_context(worker_pool(executor, jobs or available_cores()))
        place = Path(opened.enter_context(tempfile.TemporaryDirectory()) if folder is None else folder)
        make_folder(place)
        with open_rows(place / ROWS, study, restart=restart, time_limit=time_limit) as rows:
            table = table_of(study, rows, run(study, rows, pool, on_done, time_limit))
            swept = Swept(study, table, rows.dropped, plot, figures)
        if folder is not None:
            write(swept.files(place))
    return swept


def _study(problem: ProblemSource | Study, axes: Mapping[str, Any] | None, sample: Mapping[str, Any] | None) -> Study:
    """Return the study that the arguments state: a study, a study file, or a problem with axes."""
    if isinstance(problem, Study):
        return problem
    if axes is not None:
        return build_study(problem_of(problem), axes, sample)
    if isinstance(problem, str | Path):
        return read_study(Path(problem))
    raise InputError.of(
        "study", "missing-key", 'is missing; name the numbers that vary, {"device.mass": [...]}', key="axes"
    )
