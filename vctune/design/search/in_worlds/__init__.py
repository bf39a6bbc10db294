"""The least scale of a coupling in a box of environments."""
