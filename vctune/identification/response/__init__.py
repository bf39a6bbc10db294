"""A periodic excitation: its response, and the physics that is fitted to it."""
