"""Benchmarks: the cost and the quality of vctune's answers, against its peers and at the extremes."""
