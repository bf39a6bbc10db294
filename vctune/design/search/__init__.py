"""From a problem to a local optimum: theorems, scan, starts and exchange."""
