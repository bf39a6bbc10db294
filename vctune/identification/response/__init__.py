"""A periodic excitation: its response, and the physics fitted to it."""
