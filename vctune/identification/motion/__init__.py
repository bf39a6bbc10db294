"""Fit a recording of any motion in the time domain."""
