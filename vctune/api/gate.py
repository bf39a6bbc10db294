"""Plan `vctune check`: which file is checked with which problem, each as a task, in this process or in several."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from vctune.design.verdict.checked import Checked, CheckVerdict
from vctune.design.verdict.gains_check import check_problem
from vctune.document.reading import ProblemFile, gains_file, problem_file
from vctune.document.ros import is_admittance, read_admittances
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.running import seconds_left, time_limit

Progress = Callable[[str], None]
Work = Callable[[Progress], list[Checked]]


@dataclass(frozen=True, slots=True)
class _File:
    """A file that a check names. It is read only once, because it may be a pipe."""

    path: Path
    kind: Literal["problem", "gains", "region", "parameters", "unknown"]
    text: str = ""
    error: InputError | None = None


@dataclass(frozen=True, slots=True)
class Task:
    """The check of one file; `run` never raises an InputError, so that the other files are checked all the same."""

    source: Path
    work: Work

    def run(self, progress: Progress = lambda stage: None) -> list[Checked]:
        """Return the results, one for each axis of a parameter file, else one."""
        try:
            return self.work(progress)
        except InputError as error:
            return [_refused(error)]


def planned(paths: Sequence[Path], baseline: Path | None = None) -> tuple[list[ProblemFile], list[Task]]:
    """Return the problems that paths name, and the checks, in the order of the paths, with regions last. Where vctune
    cannot decide which file belongs to which problem, the only check is the refusal."""
    try:
        return _planned(paths, baseline)
    except InputError as error:
        return [], [_known(error)]


def _planned(paths: Sequence[Path], baseline: Path | None) -> tuple[list[ProblemFile], list[Task]]:
    files = [file for path in paths for file in _named(path)]
    several = sum(file.kind == "problem" for file in files) > 1
    if baseline is not None and several:
        message = "--region with several problems; name each region.json after its problem instead"
        raise InputError.of(str(baseline), "ambiguous-files", message)
    if baseline is not None:
        files.append(_File(baseline, "region"))
    if not any(file.kind == "problem" for file in files):
        files = [replace(file, kind="problem") if file.kind == "unknown" else file for file in files]
    problems, tasks, regions = list[ProblemFile](), list[Task](), list[Task]()
    for stated, given in _runs(files):
        read = [_problem(at) for at in stated]
        usable = [at for at in read if isinstance(at, ProblemFile)]
        for at in read:
            its = given if at is read[-1] or any(file.kind == "parameters" for file in given) else []
            if isinstance(at, Task):
                tasks.append(at)
            elif not its or (at.problem.bounds.fixed and all(file.error for file in its)):
                tasks.append(Task(Path(at.source), partial(_check_fixed, at)))
        for file in given:
            if file.error:
                tasks.append(_known(file.error))
            elif file.kind == "parameters" and len(usable) == len(read):
                tasks.append(Task(file.path, partial(_check_parameters, usable, file.path)))
            elif file.kind == "region" and usable and usable[-1] is read[-1]:
                regions.append(Task(file.path, partial(_check_region, usable[-1], file.path)))
            elif file.kind in ("gains", "unknown") and usable and usable[-1] is read[-1]:
                tasks.append(Task(file.path, partial(_check_gains, usable[-1], file, several)))
        problems += usable
    return problems, [*tasks, *regions]


@contextmanager
def started(tasks: Sequence[Task], jobs: int) -> Iterator[list[Work]]:
    """Yield the tasks as functions that return the results; with several jobs, processes work on all from now on."""
    if min(jobs, len(tasks)) < 2:
        yield [task.run for task in tasks]
        return
    from vctune.study.executors import worker_pool

    end = time.time() + seconds_left()
    with worker_pool("processes", min(jobs, len(tasks))) as pool:
        futures = [pool.executor.submit(_run_until, end, task) for task in tasks]
        yield [partial(lambda future, progress: future.result(), future) for future in futures]


def _run_until(end: float, task: Task) -> list[Checked]:
    with time_limit(end - time.time()):
        return task.run()


def _named(path: Path) -> list[_File]:
    """Return the file that an argument names, or the .toml files of a folder, its problem before the gains."""
    if not path.is_dir():
        return [_read(path)]
    files = [_read(file) for file in sorted(path.iterdir()) if file.suffix == ".toml"]
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    problems, gains = ([file for file in files if file.kind == kind] for kind in ("problem", "gains"))
    if len(problems) > 1 and gains:
        message = f"holds {len(problems)} problems and {len(gains)} gains files; name each problem with its gains"
        raise InputError.of(str(path), "ambiguous-files", message)
    return sorted(files, key=lambda file: file.kind == "gains")


def _read(path: Path) -> _File:
    if is_admittance(path) or path.suffix == ".json":
        return _File(path, "parameters" if is_admittance(path) else "region")
    text, called = "", toml.called(path)
    try:
        text = toml.read_text(path)
        tables = toml.parse(text, str(called)).keys()
    except InputError as error:
        stated = re.search(r"^\s*\[device\]", text, re.MULTILINE)
        return _File(called, "problem" if stated else "unknown", text, error)
    law = not tables.isdisjoint(("gains", "coupling"))
    return _File(called, "problem" if "device" in tables else "gains" if law else "unknown", text)


def _runs(files: Sequence[_File]) -> list[tuple[list[_File], list[_File]]]:
    """Return the problems that follow one another, each time with the files after them."""
    runs: list[tuple[list[_File], list[_File]]] = [([], [])]
    for file in files:
        if file.kind == "problem" and runs[-1][1]:
            runs.append(([], []))
        runs[-1][file.kind != "problem"].append(file)
    if runs[0][0] or any(file.error for file in files if len(runs) == 1):
        return runs
    if len(runs) == 2:  # a single run of problems may stand after its files
        return [(runs[1][0], runs[0][1] + runs[1][1])]
    message = "without a problem before it; name each file after its problem"
    raise InputError.of(str(runs[0][1][0].path), "ambiguous-files", message)


def _problem(file: _File) -> ProblemFile | Task:
    """Return a problem, or a task that reports why it cannot be read."""
    try:
        return _known(file.error) if file.error else problem_file(file.text, file.path)
    except InputError as error:
        return _known(error)


def _refused(error: InputError) -> Checked:
    source = Path(error.source)
    return Checked(source, source.stem, CheckVerdict.BAD_INPUT, str(error), error.mistakes[0].line or 1, None)


def _known(error: InputError) -> Task:
    return Task(Path(error.source), partial(_stated, _refused(error)))


def _stated(checked: Checked, progress: Progress) -> list[Checked]:
    return [checked]


def _check_fixed(file: ProblemFile, progress: Progress) -> list[Checked]:
    return [check_problem(file, None, progress)]


def _check_gains(file: ProblemFile, given: _File, several: bool, progress: Progress) -> list[Checked]:
    checked = check_problem(file, gains_file(given.text, given.path), progress)
    return [replace(checked, message=f"with {file.source}: {checked.message}") if several else checked]


def _check_parameters(problems: list[ProblemFile], path: Path, progress: Progress) -> list[Checked]:
    from vctune.design.ros.admittance_check import check_parameters

    return [check for given in read_admittances(path) for check in check_parameters(problems, path, given, progress)]


def _check_region(file: ProblemFile, baseline: Path, progress: Progress) -> list[Checked]:
    from vctune.study.region_check import check_region_file

    return [check_region_file(file, baseline, progress)]
