"""From a problem to proved gains: scan for starts, IPOPT on a few frequencies, exchange with the judge."""
