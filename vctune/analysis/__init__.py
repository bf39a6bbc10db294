"""Evaluate a design in double precision: extrema over frequency, margins, feel."""
