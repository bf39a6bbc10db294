"""Numbers of a design in double precision: extrema over frequency, margins. Estimates, not proofs."""
