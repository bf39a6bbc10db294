"""Storage functions that serve all dampings of a hand: a search in floats, and a proof over boxes of hands."""
