"""Members of a box of environments: the one with the least reserve, and one that makes a refuted loop grow."""
