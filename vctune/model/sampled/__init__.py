"""The exact sampled loop, let go and in a hand."""
