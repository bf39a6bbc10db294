"""Drawings that write their own SVG, in milliseconds: panels, scales, marks, labels."""
