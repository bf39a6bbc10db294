"""`vctune check`, as a function."""

from __future__ import annotations

from pathlib import Path

from vctune.design.check import Checked, check_problem
from vctune.document.building import ProblemSource
from vctune.document.building import design as design_of
from vctune.document.building import problem as problem_of
from vctune.model.quantities import Coupling, Gains


def check(problem: ProblemSource, gains: Gains | str | Path | None = None, coupling: Coupling | None = None) -> Checked:
    """Prove a design that already exists.

    Parameters
    ----------
    problem : path of a problem file, its tables as a dict, or the problem
    gains : N s/m and N/m, with their coupling; or the path of a gains file; None if the problem fixes every number
    coupling : N s/m and kg

    Returns
    -------
    Checked
        `exit_code`, `message` in one line, `warnings`; `finding.judgement` is what is proved, `finding.repairs` what
        would mend a violated design.

    Raises
    ------
    InputError
        If problem or design are none, or there is no design.
    """
    return check_problem(problem_of(problem), None if gains is None else design_of(gains, coupling))
