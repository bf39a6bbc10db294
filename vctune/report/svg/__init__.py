"""Draw figures as SVG without Matplotlib, in milliseconds: panels, scales, marks and labels."""
