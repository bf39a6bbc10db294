"""The command line: one small file per command, which reads, calls and prints."""

from __future__ import annotations

from vctune.cli.main import run

__all__ = ["run"]
