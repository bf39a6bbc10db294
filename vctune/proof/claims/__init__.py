"""The claims about a design, and their proofs for one or many designs and devices."""
