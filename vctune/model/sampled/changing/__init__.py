"""Model the sampled loop in a hand whose damping changes, and storage functions of this loop (model/README.md, section
21)."""
