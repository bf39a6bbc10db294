"""Find members of a box of environments: the one with the least reserve, and one with which the motion of a refuted
loop grows."""
