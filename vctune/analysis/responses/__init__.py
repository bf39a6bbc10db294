"""The sampled loop as arrays and matrices, for other tools."""
