"""Labels in a panel: where they lie, and which names go to the legend."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vctune.report.svg.elements import LETTER, LINE
from vctune.report.svg.labels import NEAR, ROOM, SMALL, label_curves, legend
from vctune.report.svg.panel import Panel

PLACED = re.compile(r'<text[^>]*\bx="([-\d.]+)"[^>]*\by="([-\d.]+)"[^>]*>([^<]+)</text>')


def panel_of(curves):
    """Return a panel of 200 by 100 points with a curve for each function of x from 0 to 1."""
    panel, x = Panel((0.0, 0.0, 200.0, 100.0)), np.linspace(0.0, 1.0, 201)
    for name, curve in curves.items():
        panel.plot(x, curve(x), label=name)
    panel.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    return panel


def placed(panel):
    """Return the box (left, right, low, high) of each label in the panel, in points, without the legend."""
    boxes = {}
    for element in panel.over:
        if not element.startswith("<g"):
            for x, y, name in PLACED.findall(element):
                wide, high = LETTER * SMALL * len(name) / 2, LINE * SMALL / 2
                boxes[name] = float(x) - wide, float(x) + wide, float(y) - high, float(y) + high
    return boxes


def distance(box, x, y):
    """Return the least distance from a box to points, in points."""
    left, right, low, high = box
    return np.hypot(np.maximum(np.maximum(left - x, x - right), 0), np.maximum(np.maximum(low - y, y - high), 0)).min()


def test_labels_lie_beside_their_curves_and_cover_nothing():
    curves = {
        "line": lambda x: 0.2 + 0.1 * x,
        "arch": lambda x: 0.9 - 0.8 * (x - 0.5) ** 2,
        "wave": lambda x: 0.5 + 0 * x,
    }
    panel = panel_of(curves)
    label_curves(panel)
    boxes, x = placed(panel), np.linspace(0.0, 1.0, 2001)
    assert set(boxes) == set(curves)
    for name, box in boxes.items():
        apart = {other: distance(box, 200 * x, 100 - 100 * curve(x)) for other, curve in curves.items()}
        assert min(apart.values()) >= ROOM - 1.5, "a cell of the raster and half a letter's height are rounded"
        assert apart[name] <= NEAR + 1.5
        for other, (left, right, low, high) in boxes.items():
            assert other == name or box[0] >= right or left >= box[1] or box[2] >= high or low >= box[3]


def test_a_name_without_room_goes_to_the_legend():
    panel = panel_of({f"curve {k}": lambda x, k=k: k / 40 + 0 * x for k in range(1, 40)})
    label_curves(panel)
    assert not placed(panel)
    assert all(f">curve {k}<" in "".join(panel.over) for k in range(1, 40))


def test_the_legend_of_no_marks_is_empty():
    assert legend([], 2) == ("", 0.0, 0.0)


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_the_legend_names_every_mark_once(columns):
    panel = panel_of({"a": np.sin, "b": np.cos, "c": np.tan})
    words, wide, high = legend(panel.marks, columns)
    assert [words.count(f">{name}<") for name in "abc"] == [1, 1, 1] and wide > 0 and high > 0
