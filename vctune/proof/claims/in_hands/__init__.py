"""Boxes of hands for the claims in every hand: along a resonance, and next to rest."""
