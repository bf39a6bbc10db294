"""The sampled loop as arrays and as state space: what other tools take."""
