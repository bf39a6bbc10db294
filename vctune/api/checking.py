"""Provide `vctune check` as functions. This module imports the optimiser only if a check needs it."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, Literal

from vctune.api.result import write
from vctune.design.check import Checked as Checked
from vctune.design.check import CheckVerdict as CheckVerdict
from vctune.design.check import check_problem
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design as design_of
from vctune.document.building import problem as problem_of
from vctune.document.reading import GainsFile, ProblemFile, gains_file, problem_file
from vctune.document.ros import is_admittance, read_admittances
from vctune.document.text import toml
from vctune.document.text.errors import InputError, printable
from vctune.document.text.json import printed
from vctune.document.text.output_files import make_folder
from vctune.exit_codes import ExitCode
from vctune.model.gains import AnyCoupling
from vctune.running import seconds_left
from vctune.running import time_limit as limited

LOST = ("lost.json", "lost.svg")  # Names of the files of a check that lists and draws what a region has lost
CODES = {
    CheckVerdict.PASSED: ExitCode.OK,
    CheckVerdict.UNDECIDED: ExitCode.UNDECIDED,
    CheckVerdict.FAILED: ExitCode.FAILED,
    CheckVerdict.BAD_INPUT: ExitCode.BAD_INPUT,
}

WORST_LAST = (CheckVerdict.PASSED, CheckVerdict.UNDECIDED, CheckVerdict.FAILED, CheckVerdict.BAD_INPUT)

Progress = Callable[[str], None]
Work = Callable[[Progress], list[Checked]]


def check(
    problem: ProblemSource,
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    *,
    time_limit: float = inf,
) -> Checked:
    """Prove the claims about a given design.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    gains : DesignSource, optional
        Gains, SI units, together with `coupling`; or a gains file or its path; or the path of a file of parameters of
        ROS 2's admittance_controller; None with the coupling of a servo, which has no gains, or if the problem fixes
        all.
    coupling : AnyCoupling, optional
        Coupling of the design, SI units; a `SpringDamper` for an impedance display.
    time_limit : float
        Seconds after which all unproved claims are undecided.

    Returns
    -------
    Checked
        `result` is the verdict, `message` one line of text, `warnings` the probable mistakes; `finding` has the
        `judgement` with the verdicts on the claims, and the `repairs` of a violated design. Of a file of ROS 2, the
        check of the axes with the worst verdict.

    Raises
    ------
    InputError
        If the problem or the design is invalid, if they are for different kinds of device, or if there is no design.
    """
    with limited(time_limit):
        file = problem_of(problem)
        if isinstance(gains, str | Path) and is_admittance(Path(gains)):
            checks = _parameters([file], Path(gains), lambda stage: None)
            return max(checks, key=lambda checked: WORST_LAST.index(checked.verdict))
        stated = gains is not None or coupling is not None
        design = design_of(gains, coupling, file.problem.device.kind) if stated else None
        return check_problem(file, design)


def check_region(problem: ProblemSource, baseline: str | Path) -> Checked:
    """Prove the cells and gain sets of a region file again for the present problem.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    baseline : str or Path
        Path of a region.json.

    Returns
    -------
    Checked
        `result`, `message` and `warnings`; `finding.region` contains the verdicts on cells, `finding.certified` those
        on gain sets.

    Raises
    ------
    InputError
        If the problem or the baseline is invalid, or the problem no longer has such a region.
    """
    return _region(problem_of(problem), Path(baseline))[0]


def check_object(checked: Checked) -> dict[str, Any]:
    """Return a check as an object: that of design.json, the verdict on a region, or the reason why there is neither."""
    if checked.finding is not None:
        return checked.finding.record()
    place = {"problem": {"name": printable(checked.name)}, "source": printable(str(checked.source))}
    return printed("refusal", **place, line=checked.line, status=None, reason=checked.message, warnings=[])


def record_lost(checked: Checked, folder: Path) -> str:
    """Write the cells and gain sets that a region has lost, as a list and as a picture; if everything is proved again,
    remove those of an earlier check. Return what was done, empty for nothing and for the check of gains."""
    from vctune.study.region_check import RegionFinding

    finding = checked.finding
    if not isinstance(finding, RegionFinding) or finding.cut:
        return ""
    if not finding.lost:
        gone = [path for name in LOST if (path := folder / name).exists()]
        for path in gone:
            path.unlink()
        removed = ", ".join(path.name for path in gone)
        return f"everything is proved again: removed {removed} from {folder}" if gone else ""
    from vctune.report.region_figure import lost_figure
    from vctune.report.style import picture

    make_folder(folder)
    record = json.dumps(finding.record(), indent=2, allow_nan=False)
    write({folder / LOST[0]: record + "\n", folder / LOST[1]: picture(lost_figure(finding), "lost", "svg")})
    return f"the lost cells and gain sets are listed and drawn in {folder}: {', '.join(LOST)}"


@dataclass(frozen=True, slots=True)
class _File:
    """A file that the command names, read once, because it may be a pipe; or the error that tells why it cannot be."""

    path: Path
    kind: Literal["problem", "gains", "region", "parameters"]
    problem: ProblemFile | None = None
    gains: GainsFile | None = None
    error: InputError | None = None


def planned(paths: Sequence[Path], baseline: Path | None = None) -> tuple[list[ProblemFile], list[Work]]:
    """Return the problems that paths name, and the check of each file as a function, in the order of the paths, with
    regions last. Where vctune cannot decide which file belongs to which problem, the only check is the refusal."""
    problems, works, regions = list[ProblemFile](), list[Work](), list[Work]()
    try:
        runs = list(_runs(paths, baseline))
    except InputError as error:
        return [], [_refusal(error)]
    several = sum(len(stated) for stated, _ in runs) > 1
    for stated, given in runs:
        usable = [file.problem for file in stated if file.problem]
        for_all = any(file.kind == "parameters" for file in given)
        for file in stated:
            if file.problem and not (given and (for_all or file is stated[-1])):
                works.append(partial(_guarded, _fixed, file.problem))
        for file in (*stated, *given):
            if file.error:
                works.append(_refusal(file.error))
            elif file.kind == "parameters" and len(usable) == len(stated):
                works.append(partial(_guarded, _parameters, usable, file.path))
            elif file.kind == "region" and (last := stated[-1].problem):
                regions.append(partial(_guarded, _region, last, file.path))
            elif file.gains and (last := stated[-1].problem):
                works.append(partial(_guarded, _gains, last, file.gains, several))
        problems += usable
    return problems, [*works, *regions]


def _runs(paths: Sequence[Path], baseline: Path | None) -> Iterator[tuple[list[_File], list[_File]]]:
    """Yield the problems that follow one another, each time with the files after them."""
    files = list[_File]()
    for path in paths:
        files += _named(path, first=not any(file.kind == "problem" for file in files))
    if baseline is not None:
        files.append(_File(baseline, "region"))
    count = sum(file.kind == "problem" for file in files)
    if count == 1:  # a single problem may stand after its files
        files.sort(key=lambda file: file.kind != "problem")
    if baseline is not None and count > 1:
        message = "--region with several problems; name each region.json after its problem instead"
        raise InputError.of(str(baseline), "ambiguous-files", message)
    if files[0].kind != "problem":
        message = "without a problem before it; name each file after its problem"
        raise InputError.of(str(files[0].path), "ambiguous-files", message)
    stated, given = list[_File](), list[_File]()
    for file in files:
        if file.kind == "problem" and given:
            yield stated, given
            stated, given = [], []
        (stated if file.kind == "problem" else given).append(file)
    yield stated, given


@contextmanager
def started(works: Sequence[Work], jobs: int) -> Iterator[Sequence[Work]]:
    """Yield the checks; with several jobs, processes work on all of them from now on."""
    if min(jobs, len(works)) < 2:
        yield works
        return
    from vctune.study.executors import worker_pool

    end = time.time() + seconds_left()
    with worker_pool("processes", min(jobs, len(works))) as pool:
        futures = [pool.executor.submit(_run_until, end, work) for work in works]
        yield [partial(lambda future, progress: future.result(), future) for future in futures]


def _run_until(end: float, work: Work) -> list[Checked]:
    with limited(end - time.time()):
        return work(lambda stage: None)


def _guarded(check: Callable[..., list[Checked]], *given: Any) -> list[Checked]:
    """Return the results of a check; an error is one of them, so that the other files are checked all the same."""
    try:
        return check(*given)
    except InputError as error:
        return _refused(error)


def _named(path: Path, *, first: bool) -> list[_File]:
    """Return the file that an argument names, or the .toml files of a folder, its problem before the gains."""
    if not path.is_dir():
        return [_read(path, first=first)]
    files = [_read(file, first=False) for file in sorted(path.iterdir()) if file.suffix == ".toml"]
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    problems, gains = (sum(file.kind == kind and not file.error for file in files) for kind in ("problem", "gains"))
    if problems > 1 and gains:
        message = f"holds {problems} problems and {gains} gains files; name each problem with its gains"
        raise InputError.of(str(path), "ambiguous-files", message)
    return sorted(files, key=lambda file: file.kind == "gains")


def _read(path: Path, *, first: bool) -> _File:
    """Read a file; the first one that does not state gains should be a problem."""
    if is_admittance(path) or path.suffix == ".json":
        return _File(path, "parameters" if is_admittance(path) else "region")
    text, called = "", toml.called(path)
    try:
        text = toml.read_text(path)
        tables = toml.parse(text, str(called)).keys()
        if "device" in tables or (first and tables.isdisjoint(("gains", "coupling"))):
            return _File(called, "problem", problem=problem_file(text, path))
        first = False
        return _File(called, "gains", gains=gains_file(text, path))
    except InputError as error:
        problem = first or re.search(r"^\s*\[device\]", text, re.MULTILINE)
        return _File(called, "problem" if problem else "gains", error=error)


def _refused(error: InputError) -> list[Checked]:
    source = Path(error.source)
    return [Checked(source, source.stem, CheckVerdict.BAD_INPUT, str(error), error.mistakes[0].line or 1, None)]


def _refusal(error: InputError) -> Work:
    """Return the check of a file that cannot be read; its result is made here, because an error does not pickle."""
    return partial(_known, _refused(error))


def _known(found: list[Checked], progress: Progress) -> list[Checked]:
    return found


def _fixed(file: ProblemFile, progress: Progress) -> list[Checked]:
    return [check_problem(file, None, progress)]


def _gains(file: ProblemFile, given: GainsFile, several: bool, progress: Progress) -> list[Checked]:
    checked = check_problem(file, given, progress)
    return [replace(checked, message=f"with {file.source}: {checked.message}") if several else checked]


def _parameters(problems: list[ProblemFile], path: Path, progress: Progress) -> list[Checked]:
    from vctune.design.ros.admittance_check import check_parameters

    return [check for given in read_admittances(path) for check in check_parameters(problems, path, given, progress)]


def _region(file: ProblemFile, baseline: Path, progress: Progress = lambda stage: None) -> list[Checked]:
    from vctune.study.region_check import check_region_file

    return [check_region_file(file, baseline, progress)]
