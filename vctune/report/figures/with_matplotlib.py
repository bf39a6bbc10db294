"""Draw figures with Matplotlib: their style, a layout that does not depend on the texts, and their files."""

from __future__ import annotations

import re
from collections import Counter
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.report.svg.elements import GREY, INK, PAPER
from vctune.report.typography import svg_texts
from vctune.running import check_time

STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.titlesize": 9,
    "axes.titley": 1.0,
    "figure.facecolor": PAPER,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": GREY,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "lines.linewidth": 1.6,
    "path.simplify_threshold": 0.25,
}


# Superfluous text in Matplotlib's SVG files, and its replacement
SUPERFLUOUS = {
    r"<metadata>.*?</metadata>\n": "",
    r"; font-family: [^;\"]*": "",
    r"<svg ": '<svg font-family="sans-serif" ',
    r'<g id="[^"]*">': "<g>",
    r' transform="rotate\(-0 [^"]*\)"': "",
}


def canvas(
    width: float,
    height: float,
    *,
    left: float = 0.85,
    right: float = 0.15,
    bottom: float = 0.5,
    top: float = 0.15,
    gaps: tuple[float, float] = (0.0, 0.0),
) -> Figure:
    """Return a figure whose axes keep their position for any texts around them."""
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left / width, bottom / height, 1 - right / width, 1 - top / height, wspace=gaps[0], hspace=gaps[1]
    )
    return figure


def legend_above(axes: Axes, columns: int, **options: Any) -> None:
    """Put the legend above the axes, where it covers no curve."""
    close: dict[str, Any] = {
        "borderaxespad": 0.2,
        "columnspacing": 1.1,
        "handlelength": 1.7,
        "handletextpad": 0.5,
        "fontsize": 8,
    } | options
    axes.legend(loc="lower left", bbox_to_anchor=(-0.03, 1.0), ncols=columns, **close)


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG."""
    check_time()
    stream = BytesIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    text = re.sub(r"\n +", "\n", stream.getvalue().decode())
    for long, short in SUPERFLUOUS.items():
        text = re.sub(long, short, text, flags=re.DOTALL)
    text = re.sub(r'(?<=[ \n])(d|x|y|transform)="[^"]*"', _shortened, text)
    return svg_texts(_ungrouped(_classed(text, name)))


def _classed(text: str, name: str) -> str:
    """Return an SVG in which classes replace repeated styles. Each class name belongs to one figure of the page."""
    styles = Counter(re.findall(r' style="([^"]*)"', text))
    names = {style: f"{name[0]}{name[-1]}{k}" for k, (style, count) in enumerate(styles.items()) if count > 1}
    rules = "".join(f".{named}{{{style}}}\n" for style, named in names.items())

    def put(found: re.Match[str]) -> str:
        return f' class="{names[found[1]]}"' if found[1] in names else found[0]

    return re.sub(r' style="([^"]*)"', put, text).replace("</style>", f"{rules}</style>", 1)


def _ungrouped(text: str) -> str:
    """Return an SVG without groups that have no attribute or are empty."""
    kept, opened = [], list[bool]()
    for line in text.split("\n"):
        if line.startswith("<g") and line.endswith("/>"):
            continue
        if line.startswith("<g"):
            opened.append(line != "<g>")
        useful = opened[-1] if line.startswith("<g") else opened.pop() if line == "</g>" else True
        kept += [line] if useful else []
    return "\n".join(kept)


def _shortened(attribute: re.Match[str]) -> str:
    """Return an attribute with positions rounded to a hundredth, and with each polyline as relative steps of tenths."""
    text = re.sub(r"M [^A-Za-z\"]+(L [^A-Za-z\"]+)+", _as_steps, attribute[0])
    return re.sub(r"-?\d*\.\d+(e-?\d+)?", lambda number: _rounded(float(number[0]), 2), text).replace(" \n", "\n")


def _as_steps(run: re.Match[str]) -> str:
    """Return a polyline as its start and the steps from one rounded position to the next."""
    places = [[round(10 * float(each)) for each in place.split()] for place in re.split("[ML]", run[0])[1:]]
    steps = [(x_end - x, y_end - y) for (x, y), (x_end, y_end) in pairwise(places)]
    seen = [step for step in steps if step != (0, 0)] or steps[:1]
    start, *along = (" ".join(_rounded(each / 10, 1) for each in place) for place in (places[0], *seen))
    return f"M {start}\nl {' '.join(along)}\n".replace(" -", "-")


def _rounded(value: float, decimals: int) -> str:
    return re.sub(r"^(-?)0(?=\.)", r"\1", f"{value:.{decimals}f}".rstrip("0").rstrip("."))


def figure_file(figure: Figure, folder: Path, stem: str) -> dict[Path, str]:
    """Return a figure as an SVG file."""
    return {folder / f"{stem}.svg": svg(figure, stem)}
