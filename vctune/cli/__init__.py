"""Provide the command line. Each command is one small file that reads input, calls a function and prints the result."""

from __future__ import annotations

import os
import signal
import sys


def run() -> None:
    """Run the command line and exit with one of the codes in `vctune.exit_codes.ExitCode`."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # the caller has closed the stream
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        getattr(sys, name).reconfigure(errors="backslashreplace")
    try:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        from vctune.interrupt import raise_interrupt, report_lost_errors
        from vctune.running import process_began

        process_began()

        sys.unraisablehook = report_lost_errors
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, raise_interrupt)
        from vctune.cli.main import execute

        code = execute()
    except KeyboardInterrupt:
        _ignore_interrupts()
        sys.stderr.write("; ".join(["interrupted", *_resuming()]) + "\n")
        sys.stderr.flush()
        os._exit(130)  # CPython may remember the interrupt and die by the signal instead of exiting with a code
    _ignore_interrupts()
    sys.exit(code)


def _resuming() -> list[str]:
    from vctune.interrupt import RESUMES

    return RESUMES[-1:]


def _ignore_interrupts() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
