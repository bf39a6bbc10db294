"""Arithmetics that enclose exact results: balls, intervals, and polynomials over boxes."""
