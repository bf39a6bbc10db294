"""Boxes of hands for what is asked in every hand: along a resonance, next to rest, on the sides of a rectangle."""
