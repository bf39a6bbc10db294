"""From recordings of a device to its numbers, each with an honest interval (README.md)."""
