"""Exit codes of the commands, for whoever calls them: part of vctune's contract (cli/README.md, section 1)."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """The exit code of a vctune command."""

    OK = 0
    """Certified, or the check passed."""
    FAILED = 1
    """Infeasible, violated, or the check failed."""
    BAD_INPUT = 2
    """Bad usage, bad input, or a place that cannot be read or written."""
    UNDECIDED = 3
    """Undecided or not converged, or cut short by a time limit or an interrupt, with the result so far."""
    INTERNAL = 4
    """A fault of vctune's own."""
    INTERRUPTED = 130
    """Interrupted by SIGINT (Ctrl-C) or SIGTERM; nothing half-written is left behind."""
