"""Map verdicts to exit codes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from vctune.exit_codes import ExitCode

if TYPE_CHECKING:
    from vctune import Status
    from vctune.api.checking import CheckVerdict


def of_status(status: Status) -> ExitCode:
    """Return the exit code of a problem or a design."""
    return {"certified": ExitCode.OK, "undecided": ExitCode.UNDECIDED}.get(status, ExitCode.FAILED)


def worst(codes: Iterable[ExitCode]) -> ExitCode:
    """Return the worst of several exit codes."""
    return max(codes, key=[ExitCode.OK, ExitCode.UNDECIDED, ExitCode.FAILED, ExitCode.BAD_INPUT].index)


def of_check(result: CheckVerdict) -> ExitCode:
    """Return the exit code of a check."""
    codes = {"passed": ExitCode.OK, "undecided": ExitCode.UNDECIDED, "bad input": ExitCode.BAD_INPUT}
    return codes.get(result, ExitCode.FAILED)
