"""The arithmetics in which the formulas are evaluated, and the units of numbers."""
