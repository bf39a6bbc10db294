"""Identify the parameters of a device from recordings, each with an interval (README.md)."""
