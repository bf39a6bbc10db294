"""Define the arithmetics in which the code evaluates formulas, and the units of numbers."""
