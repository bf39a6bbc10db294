"""A recording of any motion, fitted in time."""
