"""Fit physics to the response to a periodic excitation."""
