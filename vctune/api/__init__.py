"""Provide the commands as functions: `from vctune import ...`."""
