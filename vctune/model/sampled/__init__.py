"""Evaluate the exact sampled loop, without a hand and in a hand."""
