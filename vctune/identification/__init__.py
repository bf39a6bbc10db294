"""From recordings of a device to its numbers, each with an interval that is honest (README.md)."""
