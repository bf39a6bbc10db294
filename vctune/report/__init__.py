"""A design as one page: numbers to curves, curves to figures, figures to a page. Nothing here solves or proves."""
