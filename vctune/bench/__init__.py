"""Measure the cost and the quality of vctune's answers, against other solvers and on extreme devices."""
