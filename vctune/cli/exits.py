"""Exit codes of the command line: part of vctune's contract (cli/README.md, section 1)."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vctune.design.check import CheckVerdict
    from vctune.design.judge import Status


class ExitCode(IntEnum):
    """What a vctune command tells its caller."""

    OK = 0
    """Certified, or the check passed."""
    FAILED = 1
    """Infeasible, violated, or the check failed."""
    BAD_INPUT = 2
    """Bad usage, bad input, or a place that cannot be read or written."""
    UNDECIDED = 3
    """Undecided or not converged."""
    INTERNAL = 4
    """A fault of vctune's own."""
    INTERRUPTED = 130
    """Interrupted by SIGINT (Ctrl-C) or SIGTERM; nothing half-written is left behind."""


def of_status(status: Status) -> ExitCode:
    """Return what is told of a problem or a design."""
    return {"certified": ExitCode.OK, "undecided": ExitCode.UNDECIDED}.get(status, ExitCode.FAILED)


def of_check(result: CheckVerdict) -> ExitCode:
    """Return what is told of a check."""
    codes = {"passed": ExitCode.OK, "undecided": ExitCode.UNDECIDED, "bad input": ExitCode.BAD_INPUT}
    return codes.get(result, ExitCode.FAILED)
