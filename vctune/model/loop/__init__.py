"""The velocity loop at a frequency, and what it asks of the coupling."""
