"""The velocity loop at a frequency, and the resistance that it requires of the coupling."""
