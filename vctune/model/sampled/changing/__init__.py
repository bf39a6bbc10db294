"""The sampled loop in a hand whose damping changes, and its storage functions (model/README.md, section 21)."""
