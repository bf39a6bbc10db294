"""Check existing gains, for example in continuous integration. The module imports the optimiser only to find repairs.
See cli/README.md, section 2."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from vctune.design.result import Repair
from vctune.design.variables import keys_for, ranges
from vctune.design.verdict.check_message import check_message, line_to_change, taken_back
from vctune.design.verdict.checked import VERDICTS, Checked, finding_of
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
from vctune.document.reading import GainsFile, ProblemFile
from vctune.document.schema.kinds import require_gains_of
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError, Mistake
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError

OTHER_VERSION = Note("other-version", "the gains were made for another version of the problem (sha256 differs)")


def check_problem(
    file: ProblemFile, design: GainsFile | None = None, progress: Progress = lambda stage: None
) -> Checked:
    """Check the design that a problem fixes, or another design for the problem."""
    if design is not None:
        require_gains_of(file, design)
        return _judged(file, design, progress)
    if not file.problem.bounds.fixed:
        raise InputError(file.source, [_free(file.problem)])
    fixed = file.problem.fixed_design
    own = GainsFile(file.problem.device.kind, *fixed, sha256=None, units=None, text=file.text, source=file.source)
    return _judged(file, own, progress)


def _free(problem: Problem) -> Mistake:
    free = [key for key, bounds in zip(keys_for(problem), ranges(problem), strict=True) if not bounds.fixed]
    return Mistake("not-fixed", ", ".join(free), "nothing to check: not fixed; name a gains file, or fix the numbers")


@np.errstate(all="ignore")
def _judged(file: ProblemFile, design: GainsFile, progress: Progress) -> Checked:
    """Judge a design of a problem."""
    progress(f"proving {Path(design.source).name}")
    (judgement,) = judge_all(file.problem, [(design.gains, design.coupling)], [design.corner])
    changed = edits(file.problem, judgement, design.solved) if design.sha256 == file.sha256 else []
    repairs, together = _repairs(file, judgement, changed, progress)
    notes = [OTHER_VERSION] if design.sha256 and design.sha256 != file.sha256 else []
    finding = finding_of(file, judgement, repairs, notes)
    verdict, message = VERDICTS[judgement.status], check_message(judgement, finding.repairs, changed, together)
    message = "; ".join(filter(None, [message, rendered_in_words(file.problem, judgement)]))
    line = line_to_change(design.text, finding.repairs, together)
    return Checked(Path(design.source), file.problem.name, verdict, message, line, finding)


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
