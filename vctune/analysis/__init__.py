"""Numbers of a design in double precision: extrema over frequency, margins, feel. They are estimates, not proofs."""
