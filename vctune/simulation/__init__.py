"""Simulate the paper's experiments: a continuous device with friction under a discrete controller."""
