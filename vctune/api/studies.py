"""Provide `vctune sweep` as a function."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.records.rows_json import SweepRecord
from vctune.document.study_file import Study, build_study
from vctune.document.study_file import read_study as read_study
from vctune.document.text.codes import has_code
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import make_folder, write_together
from vctune.study.executors import WorkerPool, available_cores, worker_pool
from vctune.study.rows import open_rows
from vctune.study.study_table import Table, csv_text, summary, table_of
from vctune.study.sweep import OnDone
from vctune.study.sweep import sweep as run


@dataclass(frozen=True, slots=True)
class Swept:
    """The result of a sweep."""

    study: Study  # the solved study
    table: Table  # one row for each point, with the columns of study/README.md
    dropped: int  # number of incomplete lines from an interrupted earlier run, whose points the sweep solved again

    @property
    def cut(self) -> int:
        """Number of points that the time limit cut short."""
        return sum(has_code(reason, "time-limit") for reason in self.table.reason)

    @property
    def summary(self) -> SweepRecord:
        """Counts by status, the yardstick, the best and the worst design, and the corner without designs."""
        return summary(self.study, self.table)

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
        `{"kind": "grid"}`, every combination, the default; `{"kind": "lhs", "n": n, "seed": seed}`, a Latin
        hypercube; or `{"kind": "list"}`, the axes' lists element by element.
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
    with worker_pool(executor, jobs or available_cores()) as pool, _kept(folder) as place:
        swept = _swept(study, place / "rows.jsonl", pool, on_done, restart=restart, time_limit=time_limit)
        if folder is not None:
            _write(swept, place)
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


@contextmanager
def _kept(folder: str | Path | None) -> Iterator[Path]:
    """Yield the given folder, and create it if needed; if no folder is given, yield a temporary folder."""
    if folder is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        make_folder(Path(folder))
        yield Path(folder)


def _swept(study: Study, path: Path, pool: WorkerPool, on_done: OnDone, *, restart: bool, time_limit: float) -> Swept:
    """Solve the points of a study that have no row in the file, and return the sweep with the rows of all points."""
    with open_rows(path, study, restart=restart, time_limit=time_limit) as rows:
        return Swept(study, table_of(study, rows, run(study, rows, pool, on_done, time_limit)), rows.dropped)


def _write(swept: Swept, folder: Path) -> None:
    """Write the table of a sweep and, for one or two axes, its picture."""
    from vctune.report.style import figure_file
    from vctune.report.sweep_figure import sweep_figure

    figure = sweep_figure(swept.table, grid=swept.study.sample.kind == "grid")
    pictures = figure_file(figure, folder, "error") if figure else {}
    stale = [] if figure else [folder / "error.svg"]
    write_together({folder / "table.csv": csv_text(swept.table), **pictures}, stale)
