"""Arithmetics that enclose exact results: balls, intervals, jets, and polynomials over boxes."""
