"""Each number of a design once: its computation, its place in design.json, and its words."""
