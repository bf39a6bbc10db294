"""Arithmetics that enclose: balls, intervals, jets, and polynomials over boxes."""
