"""The command line: one small file per command, which reads, calls and prints.

This module imports nothing heavy before it is ready to be interrupted.
"""

from __future__ import annotations

import os
import sys


def run() -> None:
    """Run the command line and leave the process with one of `vctune.exits.ExitCode`."""
    try:
        from vctune.cli.main import execute

        code = execute()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.stderr.flush()
        os._exit(130)  # CPython may remember the interrupt and die by the signal instead of exiting with a code
    sys.exit(code)
