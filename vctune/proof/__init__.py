"""Proof of a design in ball arithmetic. Knows nothing of how the design was found."""
