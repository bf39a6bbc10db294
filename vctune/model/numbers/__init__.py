"""Arithmetic: what formulas are evaluated in, and the units that numbers are in."""
