"""`python -m vctune`."""

from vctune.cli import run

run()
