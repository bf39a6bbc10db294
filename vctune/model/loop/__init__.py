"""The velocity loop at a frequency, and its requirement on the coupling."""
