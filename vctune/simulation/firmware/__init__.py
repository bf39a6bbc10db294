"""The firmware as equations: in floats, in symbols, compiled."""
