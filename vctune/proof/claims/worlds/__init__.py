"""Claims about boxes of environments: walls, one member of a box, and many boxes at once."""
