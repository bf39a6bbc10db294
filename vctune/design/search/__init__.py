"""From a posed problem to a local optimum: theorems, scan, starts, exchange."""
