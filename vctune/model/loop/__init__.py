"""Evaluate the velocity loop at a frequency, and the resistance that this loop requires of the coupling."""
