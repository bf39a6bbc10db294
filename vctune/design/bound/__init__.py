"""A lower bound on the error of every feasible design, by branch and bound."""
