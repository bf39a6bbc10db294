"""A lower bound on the error of every admissible design, by branch and bound."""
