"""The version of vctune, in one place."""

__version__ = "0.2.0"
