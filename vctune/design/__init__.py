"""From a problem to proved gains: a scan for starts, IPOPT on a few frequencies, and an exchange with the prover."""
