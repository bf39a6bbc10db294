"""Benchmarks: what vctune's answers cost and what they are worth, against its peers and at the extremes."""
