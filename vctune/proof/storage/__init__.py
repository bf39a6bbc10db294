"""Storage functions common to all dampings of a hand: found in floats, rounded, proved over boxes of hands."""
