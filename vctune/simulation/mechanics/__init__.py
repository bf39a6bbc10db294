"""Compute the motion of device, hand and friction over one sample."""
