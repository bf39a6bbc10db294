"""The least scale of a coupling in a box of environments, and the stiffest coupling of an impedance display."""
