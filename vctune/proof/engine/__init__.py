"""The prover: it halves intervals and boxes until each is decided."""
