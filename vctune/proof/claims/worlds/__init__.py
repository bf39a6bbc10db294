"""The claims about boxes of environments: walls, late worlds, and many boxes at once."""
