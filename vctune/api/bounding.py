"""Provide `vctune bound` as a function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from vctune.api.result import DESIGN_FILE, Files
from vctune.api.solving import SavedDesign, json_text, require_bounded, require_gap, solve
from vctune.design.bound.search import Optimality
from vctune.design.bound.search import bound as search
from vctune.design.judging.judge import Judgement, Status, judge
from vctune.design.nlp.nlp import ipopt_version
from vctune.design.prepared import prepare
from vctune.design.records.design import DesignRecord, read_design, record_of
from vctune.design.records.optimality import optimality_record
from vctune.design.result import Solved
from vctune.design.search.infeasible import OPENINGS
from vctune.design.search.optimum import Progress, improved
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile, require_record_of
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import today
from vctune.exit_codes import ExitCode
from vctune.report.paths import report_paths
from vctune.running import OutOfTimeError, check_time
from vctune.running import time_limit as limited


@dataclass(frozen=True, slots=True)
class Bounded:
    """A problem, with a proved bound on the error of every feasible design."""

    file: ProblemFile  # the problem
    record: DesignRecord  # record of the best known design, including the bound if there is one
    judgement: Judgement | None  # judgement of the best known design; None if no design is known
    optimality: Optimality | None = None  # `bound`, `gap` and `proved`

    @property
    def status(self) -> Status:
        """The status of the record: infeasible also if the search proves that no design is feasible."""
        return Status(self.record.status)

    @property
    def proved(self) -> bool:
        """Whether the gap between error and bound is at most the required gap; False without a bound."""
        return self.optimality is not None and self.optimality.proved

    @property
    def design(self) -> SavedDesign:
        """The best known design as the result of the command."""
        found = ExitCode.OK if self.proved else ExitCode.UNDECIDED
        return SavedDesign(self.file, self.record, ExitCode.FAILED if self.status is Status.INFEASIBLE else found)

    def files(self, design: Path) -> Files:
        """Return the record with the bound in place of a design.json, and what that makes of the files beside it."""
        if design.name == DESIGN_FILE:
            return self.design.files(design.parent)
        return {design: json_text(self.record)} | dict.fromkeys(report_paths(design.parent))


def bound(
    problem: ProblemSource,
    design: Solved | str | Path | None = None,
    *,
    gap: float = 0.03,
    time_limit: float = inf,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = lambda stage: None,
) -> Bounded:
    """Prove a lower bound on the error of every feasible design of a problem.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem; it must leave at least one variable free.
    design : Solved or str or Path, optional
        The result of `solve` or the path of a design.json; None to solve the problem first.
    gap : float
        The search ends when the design's error is at most (1 + gap) times the bound.
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
        known = _known(file, design, progress)
        if known.status is Status.INFEASIBLE or (known.judgement is not None and known.judgement.certificate.cut):
            return known
        prepared = prepare(file.problem)
        improve = partial(improved, prepared)
        try:
            check_time()
            found = search(
                prepared.given,
                known.judgement,
                improve,
                gap=gap,
                stopped=stopped,
                progress=lambda at: progress(str(at)),
            )
        except OutOfTimeError:
            return known
    record = _with_bound(file, known.record, found)
    return replace(known, record=record, judgement=found.improved or known.judgement, optimality=found)


def require_free(file: ProblemFile) -> ProblemFile:
    """Return a problem, or raise an error if the problem leaves no variable free."""
    if file.problem.bounds.fixed:
        raise InputError.of(file.source, "nothing-free", "fixes every number: there is nothing to choose; free one")
    require_bounded(file)
    return file


def _known(file: ProblemFile, design: Solved | str | Path | None, progress: Progress) -> Bounded:
    """Return the design from which a search starts, without a bound; this version judges that of a design.json."""
    if not isinstance(design, str | Path):
        solved = design or solve(file, progress=progress)
        return Bounded(file, record_of(file, solved, ipopt_version(), today()), solved.judgement)
    record = read_design(Path(design))
    if record.problem.sha256 != file.sha256:
        require_record_of(file, record.problem, str(design), "design")
        message = "is of another version of the problem; solve it again"
        raise InputError.of(str(design), "other-version", message, key="problem.sha256")
    if record.status == Status.INFEASIBLE.value:
        return _known(file, None, progress)
    if record.design is None:
        return Bounded(file, record, None)
    best = judge(file.problem, *record.design)
    if best.status is not Status.CERTIFIED and not best.certificate.cut:
        message = f"is not proved to meet the demands (status {best.status}); solve the problem again"
        raise InputError.of(str(design), "not-certified", message, key="gains")
    return Bounded(file, record, best)


def _with_bound(file: ProblemFile, record: DesignRecord, optimality: Optimality) -> DesignRecord:
    """Return the design's record with the bound added."""
    if optimality.improved is not None:
        solved = Solved(problem=file.problem, judgement=optimality.improved, optimality=optimality)
        return record_of(file, solved, ipopt_version(), today())
    added: dict[str, Any] = {"optimality": optimality_record(file.problem, optimality)}
    if record.gains is None and optimality.proved:
        reason = str(record.reason).replace(OPENINGS[False], OPENINGS[True], 1)
        added |= {"status": "infeasible", "reason": reason, "proved": True}
    return record.model_copy(update=added)
