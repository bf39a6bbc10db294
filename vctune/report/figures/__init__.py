"""Curves and the figures that show them."""
