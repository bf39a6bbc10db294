"""Write a figure as SVG: panels, lines, areas and texts, in points (1/72 inch)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from vctune.report.svg.elements import INK, PAPER, SIZE, number
from vctune.report.svg.panel import Panel
from vctune.running import check_time


class Drawing:
    """A figure."""

    def __init__(
        self,
        width: float,
        height: float,
        *,
        left: float = 0.85,
        right: float = 0.15,
        bottom: float = 0.5,
        top: float = 0.15,
    ) -> None:
        self.width, self.height = 72 * width, 72 * height
        self._inner = 72 * left, 72 * top, self.width - 72 * (left + right), self.height - 72 * (bottom + top)
        self.panels: list[Panel] = []
        self.over: list[str] = []

    def divide(
        self, rows: int = 1, columns: int = 1, gaps: tuple[float, float] = (0.0, 0.0), ratios: Sequence[float] = ()
    ) -> list[Panel]:
        """Divide the figure within its margins into panels, and return them row by row."""
        left, top, width, height = self._inner
        heights = np.array(ratios or [1.0] * rows, float)
        wide, tall = width / (columns + gaps[0] * (columns - 1)), height / (rows + gaps[1] * (rows - 1))
        heights *= tall * rows / heights.sum()
        starts = top + np.concatenate([[0.0], np.cumsum(heights + gaps[1] * tall)[:-1]])
        self.panels = [
            Panel((left + k * wide * (1 + gaps[0]), float(start), wide, float(high)))
            for start, high in zip(starts, heights, strict=True)
            for k in range(columns)
        ]
        return self.panels

    def svg(self, name: str) -> str:
        """Return the text of the SVG file."""
        check_time()
        size = f"{number(self.width)} {number(self.height)}"
        wide, high = size.split()
        parts = chain.from_iterable(panel.svg(f"{name}-{k}") for k, panel in enumerate(self.panels))
        return "\n".join(
            (
                '<?xml version="1.0" encoding="utf-8"?>',
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}pt" height="{high}pt" viewBox="0 0 {size}" '
                f'font-family="sans-serif" font-size="{SIZE:g}" fill="{INK}">',
                f'<path d="M0 0h{wide}v{high}h-{wide}z" fill="{PAPER}"/>',
                *parts,
                *self.over,
                "</svg>\n",
            )
        )
