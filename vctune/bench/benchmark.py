"""Define the common parts of all benchmarks: times, a table of frozen rows, findings, a picture, and their files."""

from __future__ import annotations

import csv
import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from io import StringIO
from math import isfinite
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, TypeVar

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from vctune.document.text.json import printed
from vctune.document.text.output_files import write_together
from vctune.report.style import BLUE, GREEN, GREY, INK, ORANGE, PAPER, PURPLE, RED, STYLE, svg

Made = TypeVar("Made")
Tick = Callable[[str], None]  # Type of a function that receives the name of the current stage of the measurement
REPEATS, SLOW = 5, 1.0  # Number of timed runs, and run time, s, from which there is only one
DIGITS = 6  # Number of significant digits of a number in the CSV table
INKS, MARKS = (BLUE, ORANGE, GREEN, RED, GREY, INK, PURPLE), "os^DvPX"
PANEL_WIDTH, PANEL_HEIGHT = 5.4, 4.2
MANY = 400  # Number of points above which a bitmap is smaller than a file with the coordinates


@dataclass(frozen=True, slots=True)
class Series:
    """A series of points with a name."""

    label: str
    x: list[float]
    y: list[float]
    filled: bool = True  # whether its points are filled; a hollow series has the colour of the filled one of its name


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes and its series; the horizontal axis is logarithmic."""

    title: str  # labels
    x: str
    y: str
    series: list[Series]  # the drawn series
    linear: float | None = None  # size below which the vertical axis is linear, with a line at 0; None for logarithmic


@dataclass(frozen=True, slots=True)
class Measured:
    """The result of a benchmark."""

    title: str  # title of the benchmark
    how_to_read: str  # instructions for reading the picture
    rows: list[Any]  # the rows of the table, at least one, all of one frozen dataclass
    facts: list[str]  # the findings, one sentence each
    panels: list[Panel]  # panels of the picture


def machine() -> str:
    """Return a one-line description of this machine."""
    info = Path("/proc/cpuinfo")  # of Linux
    named = [line for line in info.read_text().splitlines() if line.startswith("model name")] if info.exists() else []
    model = named[0].partition(":")[2].strip() if named else platform.processor()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    busy = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{model}, {cores} cores, {platform.system()} {platform.machine()}, Python {platform.python_version()}{busy}"


def timed(work: Callable[[], Made]) -> tuple[Made, float]:
    """Return the result of the work and its median processor time, s; slow work runs only once."""
    seconds: list[float] = []
    while not seconds or (len(seconds) < REPEATS and seconds[0] < SLOW):
        began = process_time()
        made = work()
        seconds.append(process_time() - began)
    return made, median(seconds)


def benchmark_figure(panels: list[Panel]) -> Figure:
    """Return a figure with the panels side by side."""
    with rc_context(STYLE):
        figure = Figure(figsize=(PANEL_WIDTH * len(panels), PANEL_HEIGHT), layout="constrained")
        for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            axes.set(xscale="log", yscale="log")  # set before the points are drawn, because all points may coincide
            if panel.linear:
                axes.set_yscale("symlog", linthresh=panel.linear)
                axes.axhline(0.0, color=GREY, linewidth=1, linestyle=":")
            names = list(dict.fromkeys(series.label for series in panel.series))
            for series in panel.series:
                k = names.index(series.label) % len(INKS)
                look: Any = {"color": INKS[k], "marker": MARKS[k], "markersize": 5, "linestyle": ""}
                look |= {"label": series.label} if series.filled else {"markerfacecolor": PAPER}
                axes.plot(series.x, series.y, rasterized=len(series.x) > MANY, **look)
            axes.set(title=panel.title, xlabel=panel.x, ylabel=panel.y)
            axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            axes.legend(loc="best", fontsize=8)
    return figure


def csv_of(rows: list[Any]) -> str:
    """Return the CSV text of rows of a frozen dataclass: a heading, and one line for each row."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(asdict(rows[0]).keys())
    for row in rows:
        writer.writerow(_cell(value) for value in asdict(row).values())
    return stream.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}" if isfinite(value) else "inf" if value > 0 else ""
    return str(value)


def page(name: str, measured: Measured, command: str, machine: str) -> str:
    """Return a benchmark's page in Markdown: the picture, how to read it, the findings, and how to repeat the run."""
    made_by = f"`{command}` on {machine}: [{name}.csv]({name}.csv). Seconds are processor time with one thread."
    picture, facts = f"![{measured.title}]({name}.svg)", "\n".join(f"- {fact}" for fact in measured.facts)
    return "\n\n".join([f"# {measured.title}", made_by, picture, measured.how_to_read, facts]) + "\n"


def record_of(name: str, measured: Measured, machine: str) -> dict[str, Any]:
    """Return a benchmark's result as an object for JSON."""
    said: dict[str, Any] = {"title": measured.title, "machine": machine, "facts": measured.facts}
    return printed("bench", name=name, **said, table=measured.rows)


def write_measured(folder: Path, name: str, measured: Measured, command: str, machine: str) -> None:
    """Write a benchmark's table (CSV), picture (SVG) and page (Markdown): all three, or none."""
    table, picture = csv_of(measured.rows), svg(benchmark_figure(measured.panels), name)
    said = page(name, measured, command, machine)
    write_together({folder / f"{name}.csv": table, folder / f"{name}.svg": picture, folder / f"{name}.md": said})
