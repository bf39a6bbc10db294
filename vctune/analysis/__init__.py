"""Evaluate a design in double precision: extrema over frequency, margins, feel.

The results are estimates, not proofs.
"""
