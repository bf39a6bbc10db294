"""Arithmetics in which formulas are evaluated, and the units of numbers."""
