"""Prove a design in interval arithmetic. The package does not import the search."""
