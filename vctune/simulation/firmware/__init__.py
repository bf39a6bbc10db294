"""Describe the firmware as equations, which run on floats, on symbols and as compiled C."""
