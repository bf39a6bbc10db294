"""Check existing gains, for example in continuous integration. The module imports the optimiser only to find repairs.
See cli/README.md, section 2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vctune.design.result import Repair
from vctune.design.variables import keys_for, ranges
from vctune.design.verdict.check_message import check_message, line_to_change, taken_back
from vctune.design.verdict.checked import VERDICTS, Checked, CheckVerdict, finding_of
from vctune.design.verdict.judge import Judgement, Status, judge_all
from vctune.design.verdict.parameter_changes import ParameterChange
from vctune.design.verdict.rendered import rendered_in_words
from vctune.design.verdict.repair import (
    OF_FIXED,
    Progress,
    edits,
    repairs_of_design,
    undone_together,
)
from vctune.document.gains_file import design_tables
from vctune.document.reading import GainsFile, ProblemFile, gains_file, problem_file
from vctune.document.schema.kinds import require_gains_of
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError, Mistake
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError

OTHER_VERSION = Note("other-version", "the gains were made for another version of the problem (sha256 differs)")


@dataclass(frozen=True, slots=True)
class _Input:
    """The content of a file. vctune reads each file only once, because the file may be a pipe."""

    path: Path
    text: str
    error: InputError | None
    is_gains: bool


def check_files(
    paths: Sequence[Path],
    progress: Progress = lambda stage: None,
    begun: Callable[[Problem], None] = lambda problem: None,
) -> list[Checked]:
    """Check the designs that problem files fix, or the designs of gains files for one problem."""
    inputs = [_read(path) for path in paths]
    gains = [given for given in inputs if given.is_gains]
    broken = [given for given in inputs if given.error]
    problems = [given for given in inputs if not given.is_gains and not given.error]
    if not gains and broken and len(problems) == 1:  # the file that cannot be read was to be its gains
        return [*map(_refused, broken)]
    if not gains:
        return [_refused(given) if given.error else _check_problem(given, progress, begun) for given in inputs]
    if len(problems) == 1:
        return [*map(_refused, broken), *_check_gains(problems[0], gains, progress, begun)]
    if broken:
        return [*map(_refused, broken)]
    message = f"{len(gains)} gains files with {len(problems)} problems; name exactly one problem with gains files"
    raise InputError.of(str(gains[0].path), "ambiguous-files", message)


def check_problem(file: ProblemFile, design: GainsFile | None = None) -> Checked:
    """Check the design that a problem fixes, or another design for the problem."""
    name = Path(file.problem.name)
    if design is not None:
        require_gains_of(file, design)
        given = _Input(name, design.text, None, True)
        return _judged(file, [(given, design)])[0]
    if not file.problem.bounds.fixed:
        raise InputError(file.problem.name, [_free(file.problem)])
    return _judged(file, [(_Input(name, file.text, None, False), _own_design(file))])[0]


def _own_design(file: ProblemFile) -> GainsFile:
    """Return the design of a problem that fixes every variable."""
    return GainsFile(file.problem.device.kind, *file.problem.fixed_design, sha256=None, units=None, text=file.text)


def _read(path: Path) -> _Input:
    try:
        text = toml.read_text(path)
        document = toml.parse(text, str(toml.called(path)))
    except InputError as error:
        return _Input(toml.called(path), "", error, False)
    return _Input(
        toml.called(path),
        text,
        None,
        not document.keys().isdisjoint(("gains", "coupling")) and "device" not in document,
    )


def _refused(given: _Input, error: InputError | None = None) -> Checked:
    error = error or given.error
    assert error is not None
    return Checked(given.path, given.path.stem, CheckVerdict.BAD_INPUT, str(error), error.mistakes[0].line or 1, None)


def _check_problem(given: _Input, progress: Progress, begun: Callable[[Problem], None]) -> Checked:
    try:
        file = problem_file(given.text, given.path)
        if not file.problem.bounds.fixed:
            raise InputError(str(given.path), [_free(file.problem)])
    except InputError as error:
        return _refused(given, error)
    begun(file.problem)
    return _judged(file, [(given, _own_design(file))], progress)[0]


def _check_gains(
    problem: _Input, gains: list[_Input], progress: Progress, begun: Callable[[Problem], None]
) -> list[Checked]:
    try:
        file = problem_file(problem.text, problem.path)
    except InputError as error:
        return [_refused(problem, error)]
    begun(file.problem)
    found: dict[Path, Checked] = {}
    usable = []
    for given in gains:
        try:
            read = gains_file(given.text, given.path)
            require_gains_of(file, read)
            usable.append((given, read))
        except InputError as error:
            found[given.path] = _refused(given, error)
    found |= {checked.source: checked for checked in _judged(file, usable, progress)}
    return [found[given.path] for given in gains]


def _free(problem: Problem) -> Mistake:
    free = [key for key, bounds in zip(keys_for(problem), ranges(problem), strict=True) if not bounds.fixed]
    return Mistake("not-fixed", ", ".join(free), "nothing to check: not fixed; name a gains file, or fix the numbers")


@np.errstate(all="ignore")
def _judged(
    file: ProblemFile, given: list[tuple[_Input, GainsFile]], progress: Progress = lambda stage: None
) -> list[Checked]:
    """Judge the given designs of one problem."""
    progress(f"proving {', '.join(source.path.name for source, _ in given)}")
    designs = [(design.gains, design.coupling) for _, design in given]
    judgements = judge_all(file.problem, designs, [design.corner for _, design in given])
    checks = []
    for (source, design), judgement in zip(given, judgements, strict=True):
        changed = edits(file.problem, judgement, design.solved) if design.sha256 == file.sha256 else []
        repairs, together = _repairs(file, judgement, changed, progress)
        notes = [OTHER_VERSION] if design.sha256 and design.sha256 != file.sha256 else []
        finding = finding_of(file, judgement, repairs, notes)
        verdict, message = VERDICTS[judgement.status], check_message(judgement, finding.repairs, changed, together)
        message = "; ".join(filter(None, [message, rendered_in_words(file.problem, judgement)]))
        line = line_to_change(source.text, finding.repairs, together)
        checks.append(Checked(source.path, file.problem.name, verdict, message, line, finding))
    return checks


def _repairs(
    file: ProblemFile, judgement: Judgement, changed: list[ParameterChange], progress: Progress
) -> tuple[list[Repair] | None, list[ParameterChange]]:
    """Return the repairs of a refuted design, and the edits that together undo it."""
    if judgement.status is not Status.VIOLATED:
        return None, []
    stated = toml.parse(file.text, file.problem.name)
    pasted = stated | design_tables(judgement.kind, judgement.gains, judgement.coupling)
    repairs = repairs_of_design(stated, judgement, changed, progress)
    with suppress(OutOfTimeError):
        if len(changed) > 1 and not taken_back(repairs, changed) and undone_together(pasted, changed, OF_FIXED):
            return repairs, changed
    return repairs, []
