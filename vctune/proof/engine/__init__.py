"""Intervals and boxes, halved until each is decided."""
