"""Provide `vctune bound` as a function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from vctune.api.result import DESIGN_FILE, Files
from vctune.api.solving import Design, json_text, require_gap, solve
from vctune.design.bound.nodes import ResumeState, read_resume, resume_bytes
from vctune.design.bound.search import Optimality
from vctune.design.bound.search import bound as search
from vctune.design.nlp.ipopt import ipopt_version
from vctune.design.prepared import prepare
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress, improved
from vctune.design.verdict.design_record import optimality_record, record_of
from vctune.design.verdict.infeasible import OPENINGS
from vctune.design.verdict.judge import Judgement, Status, judge
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile
from vctune.document.records.design_json import DesignRecord, read_design
from vctune.document.schema.kinds import require_record_of
from vctune.document.text.date import today
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.report.paths import report_paths
from vctune.running import OutOfTimeError, check_time
from vctune.running import time_limit as limited

SAVED = "bound.npz"  # File with the state of an unfinished search, beside design.json


@dataclass(frozen=True, slots=True)
class KnownDesign:
    """The known design with which a search for a bound begins."""

    record: DesignRecord  # record of the design, or of the reason why there is no design
    best: Judgement | None  # judgement of the design by this version; None without a design
    resume: ResumeState | None = None  # state of an earlier search


@dataclass(frozen=True, slots=True)
class Bounded:
    """A problem, with a proved bound on the error of every feasible design."""

    file: ProblemFile  # the problem
    record: DesignRecord  # record of the best known design, including the bound if there is one
    judgement: Judgement | None  # judgement of the best known design; None if no design is known
    optimality: Optimality | None  # `bound`, `gap` and `proved`

    @property
    def status(self) -> Status:
        """The status of the record: infeasible also if the search proves that no design is feasible."""
        return Status(self.record.status)

    @property
    def proved(self) -> bool:
        """Whether the gap between error and bound is at most the required gap; False without a bound."""
        return self.optimality is not None and self.optimality.proved

    @property
    def improved(self) -> bool:
        """Whether the search has found a better design than the known design."""
        return self.optimality is not None and self.optimality.improved is not None

    @property
    def design(self) -> Design:
        """The best known design as the result of the command."""
        found = ExitCode.OK if self.proved else ExitCode.UNDECIDED
        code = ExitCode.FAILED if self.status is Status.INFEASIBLE else found
        open_ = self.record.optimality is not None and self.record.optimality.verdict == "open"
        return Design(self.file, self.record, code, resumes=open_)

    def files(self, design: Path) -> Files:
        """Return the record with the bound in place of a design.json, and the state of an unfinished search."""
        saved, files = design.parent / SAVED, self.design.files(design.parent)
        if design.name != DESIGN_FILE:
            files = {design: json_text(self.record)} | dict.fromkeys(report_paths(design.parent))
        if self.optimality is not None:
            files[saved] = None if self.proved else resume_bytes(self.file.sha256, self.optimality.resume)
        return files


def bound(
    problem: ProblemSource,
    design: Solved | KnownDesign | str | Path | None = None,
    *,
    gap: float = 0.03,
    jobs: int = 1,
    time_limit: float = inf,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = lambda stage: None,
) -> Bounded:
    """Prove a lower bound on the error of every feasible design of a problem.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem; it must leave at least one variable free.
    design : Solved or KnownDesign or str or Path, optional
        The result of `solve`, the path of a design.json, or a known design; None to solve the problem first.
    gap : float
        The search ends when the design's error is at most (1 + gap) times the bound.
    jobs : int
        Number of threads.
    time_limit : float
        Seconds, including the time to solve the problem, after which the function returns the bound reached so far.
    stopped : Callable[[], bool]
        Function that returns whether to end the search now.
    progress : Progress
        Function that receives the state of the search.

    Returns
    -------
    Bounded
        The bound is valid at any time, even if the search is stopped. `optimality` is None if the time limit ended the
        work before the search, or if the problem is already known to be infeasible.

    Raises
    ------
    InputError
        If the gap is out of range, the problem invalid or fixed, or the design of another problem or not proved.
    """
    require_gap(gap)
    file = require_free(problem_of(problem))
    with limited(time_limit):
        start = _starting_design(file, design, progress)
        if start.record.status == Status.INFEASIBLE.value:
            return Bounded(file, start.record, None, None)
        unsearched = Bounded(file, start.record, start.best, None)
        if start.best is not None and start.best.certificate.cut:
            return unsearched
        prepared = prepare(file.problem)
        try:
            check_time()
            optimality = search(
                prepared.given,
                start.best,
                partial(improved, prepared),
                gap=gap,
                jobs=jobs,
                resume=start.resume,
                stopped=stopped,
                progress=lambda at: progress(str(at)),
            )
        except OutOfTimeError:
            return unsearched
    return Bounded(file, _with_bound(file, start.record, optimality), optimality.improved or start.best, optimality)


def require_free(file: ProblemFile) -> ProblemFile:
    """Return a problem, or raise an error if the problem leaves no variable free."""
    if file.problem.bounds.fixed:
        raise InputError.of(file.source, "nothing-free", "fixes every number: there is nothing to choose; free one")
    return file


def known_design(file: ProblemFile, path: Path, *, given: bool) -> KnownDesign | None:
    """Return the given design, or the design of an unfinished search."""
    resume = read_resume(path.parent / SAVED, file.sha256)
    if resume is None and not given:
        return None
    try:
        record, best = _read(file, path)
    except InputError:
        if given:
            raise
        return None
    return None if record.status == Status.INFEASIBLE.value else KnownDesign(record, best, resume)


def _starting_design(
    file: ProblemFile, design: Solved | KnownDesign | str | Path | None, progress: Progress
) -> KnownDesign:
    """Return the design from which a search starts: the given design, or the solution of the problem."""
    if isinstance(design, KnownDesign):
        return design
    if isinstance(design, str | Path) and (start := known_design(file, Path(design), given=True)) is not None:
        return start
    solved = design if isinstance(design, Solved) else solve(file, progress=progress)
    resume = solved.optimality.resume if solved.optimality is not None else None
    return KnownDesign(record_of(file, solved, ipopt_version(), today()), solved.judgement, resume)


def _read(file: ProblemFile, path: Path) -> tuple[DesignRecord, Judgement | None]:
    """Return the record in a design.json of the problem, and the judgement of this version on the design."""
    record = read_design(path)
    if record.problem.sha256 != file.sha256:
        require_record_of(file, record.problem, str(path), "design")
        message = "is of another version of the problem; solve it again"
        raise InputError.of(str(path), "other-version", message, key="problem.sha256")
    if record.design is None:
        return record, None
    best = judge(file.problem, *record.design)
    if best.status is not Status.CERTIFIED and not best.certificate.cut:
        message = f"is not proved to meet the demands (status {best.status}); solve the problem again"
        raise InputError.of(str(path), "not-certified", message, key="gains")
    return record, best


def _with_bound(file: ProblemFile, record: DesignRecord, optimality: Optimality) -> DesignRecord:
    """Return the design's record with the bound added."""
    if optimality.improved is not None:
        solved = Solved(problem=file.problem, judgement=optimality.improved, optimality=optimality)
        return record_of(file, solved, ipopt_version(), today())
    added: dict[str, Any] = {"optimality": optimality_record(optimality)}
    if record.gains is None and optimality.proved:
        reason = str(record.reason).replace(OPENINGS[False], OPENINGS[True], 1)
        added |= {"status": "infeasible", "reason": reason, "proved": True}
    return record.model_copy(update=added)
