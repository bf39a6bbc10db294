"""Provide the sampled loop as arrays and matrices, for other tools."""
