"""A design as one page: numbers become curves, curves become figures, and figures become a page."""
