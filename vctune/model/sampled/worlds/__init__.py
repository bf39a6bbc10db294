"""Evaluate the sampled loop in a hand with each environment of a box: on time, late, and with walls."""
