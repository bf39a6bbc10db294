"""Arithmetic that encloses: balls, intervals, jets, polynomials over boxes."""
