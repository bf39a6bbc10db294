"""Provide `vctune solve` and `vctune report` as functions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from shlex import quote
from typing import Any

from vctune.api.argument_ranges import GAPS, STDIN
from vctune.api.result import DESIGN_FILE, GAINS_FILE, Files, Line, Printed, Table, code_of, write
from vctune.design.advice.division import DIVISION, with_known_division
from vctune.design.advice.prices import PRICES, with_prices
from vctune.design.advice.relaxations import RELAXATIONS, with_relaxations
from vctune.design.advice.repair import REPAIRS, with_repairs
from vctune.design.judging.judge import Status
from vctune.design.records.design import DesignRecord, design_of, read_design, record_of
from vctune.design.result import Repair, Solved
from vctune.design.search.along_limit import has_nothing_behind
from vctune.design.search.optimum import Progress
from vctune.design.solve import solve as find
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.gains_file import gains_text, numbers_text
from vctune.document.reading import ProblemFile
from vctune.document.text.errors import InputError, has_code, printable
from vctune.document.text.output_files import make_folder, today
from vctune.document.text.toml import called
from vctune.exit_codes import ExitCode
from vctune.report.paths import REPORT as REPORT
from vctune.report.paths import report_paths
from vctune.running import time_limit as limited
from vctune.simulation.simulation_record import FILE as SIMULATION_FILE
from vctune.simulation.simulation_record import SimulationRecord, read_simulation

AFTERWARDS = {REPAIRS, RELAXATIONS, DIVISION, PRICES}  # Stages that a proved design does not wait for
COLOURS = {"certified": "green", "violated": "red", "infeasible": "red", "undecided": "yellow"}


def solve(
    problem: ProblemSource,
    *,
    gap: float | None = None,
    prices: bool = False,
    time_limit: float = inf,
    progress: Progress = lambda stage: None,
) -> Solved:
    """Find the most transparent feasible design and prove it.

    If the problem fixes every variable, judge the fixed design.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    gap : float, optional
        Share by which the error may exceed the proved lower bound of every design's; None for no such proof.
    prices : bool
        Whether to compute the prices of an optimum: how the error falls if a parameter of the device is 1 % better.
    time_limit : float
        Seconds after which the function returns the result so far; `cut` then names the missing parts.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    Solved
        `status`, and `judgement` with the best design and its proved claims. Without a design, `judgement` is None,
        `reason` states why, and `repairs` lists changes of one value that give a design, the least change first. A
        refuted design also has `repairs`.

    Raises
    ------
    InputError
        If the problem is invalid; if the gap is out of range; or if vctune cannot bound the error from below.
    """
    file = problem_of(problem)
    with limited(time_limit):
        return advised(file, proved(file, gap=gap, progress=progress), prices=prices, progress=progress)


def proved(file: ProblemFile, *, gap: float | None = None, progress: Progress = lambda stage: None) -> Solved:
    """Find and prove the best design, without advice."""
    if gap is not None:
        require_gap(gap)
        require_bounded(file)
    return find(file.problem, progress, gap=gap)


def advised(
    file: ProblemFile, solved: Solved, *, prices: bool = False, progress: Progress = lambda stage: None
) -> Solved:
    """Return a solved problem with repairs of a refuted design, relaxations for one of little use, and prices."""
    solved = with_relaxations(file, with_repairs(file, solved, progress), progress)
    solved = with_known_division(solved, progress)
    if not prices:
        return solved
    progress(f"pricing the device; {solved.known}")
    return with_prices(solved)


def require_bounded(file: ProblemFile) -> None:
    """Check that vctune can bound the error of a problem's designs."""
    found = None
    if file.problem.rigid:
        found = "environment.stiffness", "makes the coupling a wall"
    elif has_nothing_behind(file.problem):
        found = "environment", "leaves mass and drag alone to choose"
    if found is not None:
        message = f"{found[1]}, whose error has no proved bound; leave the gap out"
        raise InputError.of(file.source, "contradiction", message, key=found[0])


def require_gap(gap: float) -> None:
    """Check that a gap is in the range that vctune can prove."""
    low, high = GAPS
    if not low <= gap <= high:
        raise InputError.of("gap", "bad-option", f"{gap:g} is out of range: must be from {low:g} to {high:g}")


@dataclass(frozen=True, slots=True)
class SavedDesign:
    """The record of a design, or of the reason why there is none, with the file of its problem."""

    file: ProblemFile
    found: DesignRecord
    exit_code: ExitCode

    def rows(self) -> Printed:
        """Yield the status and the proved claims, the numbers, the repairs and the warnings."""
        return rows_of(self.found)

    def advice(self, known: Sequence[str]) -> Printed:
        """Yield what was found after the design was printed with some warnings."""
        return advice_of(self.found, [line for line in self.found.warnings if line not in known])

    def with_advice(self, solved: Solved) -> SavedDesign:
        """Return the design with the relaxations and prices that were computed after it, and what was cut short."""
        notes = [note.line for note in (*solved.cut_short, *solved.notes)]
        warnings = list(dict.fromkeys([*self.found.warnings, *notes]))
        also = {"prices": solved.prices, "relaxations": solved.relaxations or None}
        known = {name: part for name, part in also.items() if part is not None}
        return replace(self, found=self.found.model_copy(update=known | {"warnings": warnings}))

    def files(self, folder: Path) -> Files:
        """Return design.json and gains.toml, in place of an earlier report and, without a design, earlier gains."""
        record, kind = self.found, self.file.problem.device.kind
        files: Files = {folder / DESIGN_FILE: json_text(record), folder / GAINS_FILE: None}
        if record.design is not None and record.certificate is not None:
            origin: dict[str, str | float] = {
                "problem": self.file.problem.name,
                "sha256": self.file.sha256,
                "vctune": str(record.versions["vctune"]),
                "verdict": record.certificate.verdict,
                "numbers": numbers_text(kind, *record.design),
            }
            if (hands := record.certificate.hands) is not None and hands.walls is not None:
                origin["corner_hz"] = hands.walls.corner_hz
            files[folder / GAINS_FILE] = gains_text(kind, *record.design, origin, record.problem.units)
        return files | dict.fromkeys(report_paths(folder))

    def steps(self, folder: Path) -> list[str]:
        """Return the next steps: look at the report, repair the problem, or use the design."""
        design, source, named = folder / DESIGN_FILE, self.file.source, self.file.source != str(called(STDIN))
        look = [f"open {folder / REPORT}" if (folder / REPORT).exists() else f"vctune report {quote(str(design))}"]
        own = [repair for repair in self.found.repairs or [] if not repair.assumes][:1]
        if first := self.found.together or own:
            both = " and ".join(repair.needs for repair in first)
            return [f"write {both} into {source if named else 'the problem'} and solve again", *look]
        if self.found.status != Status.CERTIFIED.value:
            return look
        if self.found.relaxations:
            relaxed = self.found.relaxations[0].needs
            look = [f"write {relaxed} into {source if named else 'the problem'} and solve again", *look]
        check = f"in CI vctune check {quote(source)} {quote(str(folder / GAINS_FILE))}"
        return [*look, f"vctune export {quote(str(design))}", *[check] * named]


def designed(file: ProblemFile, solved: Solved, *, strict: bool = False) -> SavedDesign:
    """Return a solved problem as the result of a command; if `strict`, a warning is a failure."""
    from vctune.design.nlp.nlp import ipopt_version

    record = record_of(file, solved, ipopt_version(), today())
    named = record.problem.model_copy(update={"source": file.source})
    record = record.model_copy(update={"problem": named})
    doubts = [warning for warning in record.warnings if not has_code(warning, "time-limit")]
    searched = all(stage in AFTERWARDS for stage in solved.cut)
    if strict and doubts and searched:
        return SavedDesign(file, record, ExitCode.FAILED)
    whole = searched and (solved.optimality is None or solved.optimality.proved)
    undecided = not whole and solved.status is Status.CERTIFIED
    return SavedDesign(file, record, ExitCode.UNDECIDED if undecided else code_of(solved.status))


def replaced_by(file: ProblemFile, folder: Path) -> str | None:
    """Return the file of another problem whose design is in a folder; None without one."""
    try:
        before = json.loads((folder / DESIGN_FILE).read_text(encoding="utf-8"))["problem"]["source"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if not isinstance(before, str) or not Path(before).is_file() or not Path(file.source).is_file():
        return None
    return None if Path(before).samefile(file.source) else before


def rows_of(record: DesignRecord) -> Printed:
    """Yield what a design says: its status and claims, its numbers, its repairs and its warnings."""
    idle = ", but it hardly uses its velocity loop" if record.idle else ""
    limp = ", but its K_p holds no static force" if record.felt and record.felt.limp and not idle else ""
    colour = COLOURS["undecided" if idle else record.status]
    name = printable(record.problem.name)
    yield (name, "bold"), ": ", (f"{record.status}{idle}", f"bold {colour}"), limp
    yield from ((line,) for line in (record.promise, record.reason) if line)
    groups = {group: [(group, *row) for row in rows] for group, rows in record.groups().items()}
    first = [row for group in ("gains", "coupling") for row in groups.pop(group, [])]
    limits = [("limited by", "", "", line) for line in record.limits]
    if record.gains is not None:
        yield Table([*first, *limits, *(row for rows in groups.values() for row in rows)], right=(2,))
    if record.together:
        yield ("these two together would do:",)
        width = max(len(repair.needs) for repair in record.together)
        yield from (_repair(repair, width) for repair in record.together)
    own, assumed = ([each for each in record.repairs or [] if each.assumes == kind] for kind in (False, True))
    for title, repairs in (("any one of these alone would do:", own), ("or one of these, if it is so:", assumed)):
        if repairs:
            yield (title,)
            width = max(len(repair.needs) for repair in record.repairs or [])
            yield from (_repair(repair, width) for repair in repairs)
    if record.tried and not record.together:
        yield (f"none of these, each changed alone, gives a design: {', '.join(record.tried)}",)
    yield from advice_of(record, record.warnings)


def advice_of(record: DesignRecord, warnings: Sequence[str]) -> Printed:
    """Yield warnings, and what a design of little use costs."""
    yield from ((("warning:", "yellow"), f" {warning}") for warning in warnings)
    for relaxation in record.relaxations or []:
        yield ("of little use: ", (str(relaxation), "bold"))


def _repair(repair: Repair, width: int) -> Line:
    end = f"  instead of {repair.told_old}: {repair.change}, {repair.told_error}"
    return "  ", (repair.needs.ljust(width), "bold"), end


def write_design(problem: ProblemSource, solved: Solved, folder: str | Path) -> Path:
    """Write gains.toml and design.json, and remove the report of an earlier design.

    Parameters
    ----------
    problem : ProblemSource
        The problem that was solved.
    solved : Solved
        Result of `solve`.
    folder : str or Path
        Folder for the files; the function creates it if it does not exist.

    Returns
    -------
    Path
        The path of design.json.

    Raises
    ------
    InputError
        If the folder cannot be written. The function then changes no file.
    """
    make_folder(Path(folder))
    write(designed(problem_of(problem), solved).files(Path(folder)))
    return Path(folder) / DESIGN_FILE


def write_report(design: str | Path | Mapping[str, Any] | DesignRecord, folder: str | Path | None = None) -> Path:
    """Write the report of a design, report.html and its figures, without solving again.

    Parameters
    ----------
    design : str or Path or Mapping[str, Any] or DesignRecord
        Path of a design.json, the file's object, or its record.
    folder : str or Path, optional
        Folder for the report; the function creates it if it does not exist. None for the folder of the
        design.json; required if `design` is no path. If the folder of the design.json, or without a path this
        folder, has a simulation.json of the design, the report also shows the simulation.

    Returns
    -------
    Path
        The path of report.html.

    Raises
    ------
    InputError
        If there is no such design, if its object is invalid, or if the folder is missing or cannot be written.
    """
    from vctune.report.page import write_report as draw

    if isinstance(design, str | Path):
        record, beside = read_design(Path(design)), Path(design).parent
    elif folder is None:
        raise InputError.of("folder", "bad-option", "is missing; name the folder of the report")
    else:
        record, beside = design_of(dict(design) if isinstance(design, Mapping) else design, "design"), Path(folder)
    simulation, folder = _simulation_in(beside, record), beside if folder is None else Path(folder)
    make_folder(folder)
    draw(record, folder, simulation)
    return folder / REPORT


def _simulation_in(folder: Path, design: DesignRecord) -> SimulationRecord | None:
    """Return the content of a folder's simulation.json if there is one and it belongs to a given design; else None."""
    path = folder / SIMULATION_FILE
    if not path.exists():
        return None
    found = read_simulation(path)
    return found if found.is_of(design.problem, design.gains, design.coupling) else None


def known_record(source: Any) -> DesignRecord | None:
    """Read the record of a design from a file or an object. Return None if the source states a problem."""
    if isinstance(source, DesignRecord):
        return design_of(source, "design")
    if isinstance(source, str | Path) and Path(source).suffix == ".json":
        return read_design(Path(source))
    return design_of(dict(source), "design") if isinstance(source, Mapping) and "schema" in source else None


def json_text(record: DesignRecord) -> str:
    """Return the text of a design.json."""
    return json.dumps(record.to_json(), indent=2, allow_nan=False) + "\n"
