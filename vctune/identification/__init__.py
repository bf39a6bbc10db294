"""Identify a device from recordings: its numbers, each with an interval that covers all uncertainty (README.md)."""
