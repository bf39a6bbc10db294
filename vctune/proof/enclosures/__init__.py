"""Arithmetics that enclose exact results: intervals, and polynomials over boxes."""
