"""Measure the cost and the quality of vctune's answers, compared with other solvers and on extreme devices."""
