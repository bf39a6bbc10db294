"""Proof of a design in ball arithmetic. Does not import the search."""
