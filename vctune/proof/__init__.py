"""Prove a design in ball arithmetic. The package does not import the search."""
