"""Solve many designs: the points of a study, the workers that solve them, and the file of rows."""
