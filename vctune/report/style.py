"""The look of figures, numbers and formulas: one style for a page, its tables and its pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from html import escape, unescape
from io import BytesIO, StringIO
from math import ceil, floor, inf, isclose, isfinite, log10, pi, sqrt
from typing import Any, NamedTuple, cast

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, NullFormatter

from vctune.document.records.part import SHOWN_AS_ZERO
from vctune.model.problem import Band
from vctune.report.paths import FigureKind
from vctune.running import check_time

INK, PAPER = "#010203", "#fefdfc"  # A page replaces both by its own text and ground
BLUE, ORANGE, GREEN, RED, GREY = "#3b82d0", "#e08a1e", "#2f9e62", "#d6453d", "#8a8f98"
PURPLE = "#8d5bc4"
WIDTH = 4.2  # Width of a figure of a page, inches
TENTHS = 1e-4  # Least number at a tick that is a plain decimal, unless it is a power of ten
# Room beside a y axis with its label, of its ticks alone, beside the last tick of an x axis, below it, between rows
# that share it, and of a title or a row of a legend, inches
BESIDE, TICKS, END, BELOW, BETWEEN, ROW = 0.68, 0.44, 0.2, 0.42, 0.1, 0.17
STYLE: Any = {
    "figure.constrained_layout.use": True,
    "figure.dpi": 150,  # of what an SVG file shows as a bitmap
    "svg.fonttype": "none",
    "path.simplify_threshold": 0.25,
    "font.size": 9,
    "axes.titlesize": 8,
    "axes.titley": 1.0,  # over nothing that has to be measured
    "legend.fontsize": 8,
    "lines.linewidth": 1.6,
    "hatch.linewidth": 0.6,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    "figure.facecolor": PAPER,
    "axes.facecolor": "none",
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "axes.grid": True,
    "grid.color": GREY,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
}
THIN = "\u202f"  # Thin space between a number and its unit
DIGITS = 4  # Number of significant digits where a reader does not need to copy the number
SAME = 1e-9  # Relative difference within which a limit equals a round number
PLAIN = (0.1, 1e4)  # Sizes between which a number keeps its unit without a prefix
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
PREFIXED = ("N", "Hz", "m", "s", "W")  # First letters of the units that take a prefix
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SYMBOL = re.compile(r"(?<![\w.\"'])([A-Za-zτ])_([A-Za-z0-9]{1,5}\b)(?![_.])")  # A letter with a subscript
# Patterns of plain signs, each with its typographic form; a minus between symbols has spaces around it
SIGNS: dict[str, str | Callable[[re.Match[str]], str]] = {
    r">=": "≥",
    r"<=": "≤",
    r"(?<![\w.)])-(?=\d)": "−",
    r"(?<=\w|\|) - (?=[\w|])": " − ",
    r"(\d)e([+-]\d+)(?!\w)": lambda found: f"{found[1]} × {power_of_ten(int(found[2]))}",
}


class Quantity(NamedTuple):
    """A number and its unit, as texts."""

    value: str
    unit: str

    def __str__(self) -> str:
        return f"{self.value}{THIN * (self.unit not in ('', '°'))}{self.unit}"


def quantity(value: float | None, unit: str = "", digits: int = DIGITS, to: float | None = None) -> Quantity:
    """Return a number, or a range `to` a greater one, in its unit with a prefix that suits the greatest."""
    values = [value] if to is None else [value, to]
    power, unit = prefixed(max((abs(each) for each in values if each is not None and each != inf), default=0.0), unit)
    unit = {"deg": "°"}.get(unit, re.sub(r"(?<=[a-z])2\b", "²", unit).replace(" ", THIN))
    return Quantity(" to ".join(_number(each, power, digits) for each in values), unit)


def prefixed(size: float, unit: str) -> tuple[int, str]:
    """Return the power of ten of a suitable prefix, and the unit with this prefix."""
    if size == 0 or PLAIN[0] <= size < PLAIN[1] or not (unit == "kg" or unit.startswith(PREFIXED)):
        return 0, unit
    own, most = (3, 3) if unit == "kg" else (0, 9)
    power = min(max(3 * floor(log10(size * (1 + 1e-12)) / 3) + own, -9), most)
    return power - own, f"{PREFIXES[power]}{'g' if own else unit}"


def _number(value: float | None, power: int, digits: int) -> str:
    if value is None:
        return "none"
    if abs(value) == inf:
        return "∞" if value > 0 else "−∞"
    scaled = float(f"{value / 10.0**power:.{digits}g}") if abs(value) >= SHOWN_AS_ZERO else 0.0
    if not scaled or 1e-3 <= abs(scaled) < 1e6:
        return plain(f"{scaled:.10g}")
    mantissa, _, exponent = f"{scaled:.{digits - 1}e}".partition("e")
    return plain(f"{float(mantissa):g}e{exponent}")


def limit(value: float | None, unit: str = "", digits: int = DIGITS, *, up: bool = False) -> Quantity:
    """Return a limit as `quantity` does, rounded to the safe side: up if smaller ones would be better, else down."""
    if value is None or not isfinite(value):
        return quantity(value, unit, digits)
    near = value + (-SAME if up else SAME) * abs(value)  # what equals a round number but for an error of floats stays
    rounding = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return quantity(float(rounding.create_decimal_from_float(near)), unit, digits)


def in_place(value: float | None, hz: float | None, *, up: bool = False) -> str:
    """Return an extremum, rounded to the safe side, and its frequency; without one it is the limit for high ones."""
    where = "where ω → ∞" if hz is None else f"at {quantity(hz, 'Hz')}"
    return f"{limit(value, up=up)} {where}"


def power_of_ten(exponent: int) -> str:
    """Return a power of ten with superscript figures."""
    return f"10{str(exponent).translate(SUPERSCRIPT)}"


def tick(value: float, _place: float = 0, digits: int = DIGITS) -> str:
    """Return the text at a tick of an axis. Very large and very small powers of ten are written as powers."""
    power = round(log10(value)) if value > 0 else 0
    if not -3 < power < 4 and isclose(value, 10.0**power):
        return power_of_ten(power)
    return f"{value:.{digits}g}" if TENTHS <= value < 1e-3 else _number(value, 0, digits)


def text_of_ticks(values: Sequence[float]) -> list[str]:
    """Return the texts of ticks with as few digits as keep them apart."""
    for digits in range(DIGITS, 16):
        texts = [tick(value, digits=digits) for value in values]
        if len(set(texts)) == len(set(values)):
            break
    return texts


def plain(text: str) -> str:
    """Return a sentence with typographic signs; its numbers keep their digits."""
    for sign, put in SIGNS.items():
        text = re.sub(sign, put, text)
    return text


def html(text: str) -> str:
    """Return a sentence as escaped HTML, with symbols in italics and subscripts."""
    words = SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escape(plain(text), quote=False))
    return re.sub("`([^`]+)`", r"<code>\1</code>", words)


def log_ticks(low: float, high: float) -> LogLocator:
    """Return ticks at powers of ten, or at 1, 2 and 5 times these powers if there are few of them."""
    return LogLocator(subs=(1.0,) if high > 100 * low else (1.0, 2.0, 5.0))


def logarithmic(axes: Axes, which: str = "y") -> None:
    """Make the axis x or y logarithmic, with plain decimals; y spans a decade at least, so that its ticks differ."""
    axes.set(**{f"{which}scale": "log"})
    if which == "y":
        low, high = axes.get_ylim()
        wider = max(sqrt(10 * low / high), 1.0)
        axes.set_ylim(low / wider, high * wider)
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(log_ticks(*axis.get_view_interval()))
    axis.set_major_formatter(tick)
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_minor_formatter(NullFormatter())


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    """Turn the x axis into a frequency axis."""
    axes.set(xlim=(low, high), xlabel="frequency, Hz")
    logarithmic(axes, "x")


def legend_above(axes: Axes, columns: int) -> int:
    """Put the legend above the axes, where it covers no curve, and return its number of rows."""
    close: dict[str, Any] = {"borderaxespad": 0.2, "columnspacing": 1.1, "handlelength": 1.9, "handletextpad": 0.5}
    axes.legend(loc="lower left", bbox_to_anchor=(-0.03, 1.0), ncols=columns, **close)
    return ceil(len(axes.get_legend_handles_labels()[1]) / columns)


def place(figure: Figure, panels: Sequence[Sequence[Axes]], shares: Sequence[float], above: Sequence[int]) -> None:
    """Place rows of axes with these shares of the height, each below so many rows of legends and titles. The rooms
    are fixed, because a layout that measures each text takes longer than the drawing."""
    figure.set_layout_engine("none")
    columns, (width, height) = len(panels[0]), figure.get_size_inches()
    rooms = [ROW * rows + 0.1 for rows in above]
    wide = (width - BESIDE - END - (TICKS + END) * (columns - 1)) / columns
    free, top = height - sum(rooms) - BELOW - BETWEEN * (len(panels) - 1), height
    for row, share, room in zip(panels, shares, rooms, strict=True):
        high, top = free * share / sum(shares), top - room
        for column, axes in enumerate(row):
            left = BESIDE + column * (wide + END + TICKS)
            axes.set_position((left / width, (top - high) / height, wide / width, high / height))
            axes.yaxis.set_label_coords((0.19 - BESIDE) / wide, 0.5)
        top -= high + BETWEEN


def shade(axes: Axes, band: Band, colour: str, label: str, hatch: str = "") -> None:
    """Shade the part of a band that lies on the frequency axis."""
    low, high = axes.get_xlim()
    ends = max(band.min / (2 * pi), low), min(band.max / (2 * pi), high)
    axes.axvspan(*ends, facecolor=colour, alpha=0.13, label=label, hatch=hatch, edgecolor=colour, linewidth=0)


def picture(figure: Figure, name: str, kind: FigureKind) -> str | bytes:
    """Return a figure that stands alone as SVG text, or as the bytes of a PDF or PNG file. Its symbols are placed by
    Matplotlib, as not every program centres texts with subscripts."""
    check_time()
    figure.set_facecolor("white")
    for text in figure.findobj(Text):
        text.set_text(SYMBOL.sub(r"$\1_{\\mathrm{\2}}$", plain(text.get_text())))
    if kind == "svg":
        return svg(figure, name)
    stream = BytesIO()
    with rc_context({"pdf.fonttype": 42}):
        metadata = {"Creator": None, "Producer": None, "CreationDate": None} if kind == "pdf" else {"Software": None}
        figure.savefig(stream, format=kind, dpi=300, metadata=metadata)
    return stream.getvalue()


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG in the reader's font; figures made alike give the same text under the same name."""
    check_time()
    stream, canvas = StringIO(), cast(Any, FigureCanvasSVG(figure))
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):  # savefig would draw the figure twice
        canvas.print_svg(stream, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = re.sub(r"; font-family: [^;\"]*", "; font-family: sans-serif", stream.getvalue())
    text = re.sub(r'[ \n](d|x|y|transform)="[^"]*"', lambda found: re.sub(r"(?<=\.\d\d)\d+", "", found[0]), text)

    def typeset(found: re.Match[str]) -> str:
        # sizes in px, because not every program knows shares of them
        size = float((re.search(r"font(?:-size)?: ([\d.]+)px", found[1]) or ["", "9"])[1])
        lowered = (
            f'\\1<tspan dy="{0.25 * size:.2f}" style="font-size: {0.72 * size:.2f}px">\\2</tspan>'
            f'<tspan dy="{-0.25 * size:.2f}">\u200b</tspan>'
        )
        return f"{found[1]}{SYMBOL.sub(lowered, escape(plain(unescape(found[2])), quote=False))}{found[3]}"

    return re.sub(r"(<text[^>]*>)([^<]*)(</text>)", typeset, text)
