"""Exit codes of the commands. They are part of vctune's contract with its callers (cli/README.md, section 1)."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """The exit code of a vctune command."""

    OK = 0  # The design is certified, the check passed, or a command without a verdict did its work
    # The problem is infeasible, a constraint is violated, the check failed, or a simulated design or firmware failed
    FAILED = 1
    BAD_INPUT = 2  # The usage or the input is wrong, or a file or folder cannot be read or written
    UNDECIDED = 3  # The result is undecided or not converged, or a time limit or an interrupt cut the work short
    INTERNAL = 4  # vctune itself has a fault
    INTERRUPTED = 130  # SIGINT (Ctrl-C) or SIGTERM interrupted the command; nothing half-written is left behind
