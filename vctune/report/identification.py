"""The page of an identification, with one picture: recordings and fits, and each number with its interval."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.document.records.identification_json import IdentificationRecord, device_text
from vctune.identification.identify import Identified
from vctune.identification.study import Curves, Lines, covered
from vctune.report.design_figures import Shown
from vctune.report.page import figure_entries
from vctune.report.paths import IDENTIFICATION_FIGURES, REPORT
from vctune.report.style import (
    BLUE,
    GREY,
    ORANGE,
    STYLE,
    WIDTH,
    canvas,
    decades,
    frequency_axis,
    in_prefixed,
    legend_above,
    svg,
)
from vctune.report.typography import span, templates, words

WINDOW = 600  # Greatest number of samples in the enlarged part of a log
MOST_POINTS = 2000  # Greatest number of drawn points of a log, up to a factor of 2


def identification_files(found: Identified, record: IdentificationRecord, folder: Path) -> dict[Path, str]:
    """Return the picture and the report of an identification. The page is the last file."""
    put, (name,) = record.units.translated, IDENTIFICATION_FIGURES
    widest = max(record.numbers, key=lambda each: each.share)
    said = f"{widest.key} has the widest range: {span(widest.low, widest.high, widest.unit)}, "
    said += f"± {100 * widest.share:.2g} %."
    left = max(each.residual_share or 0.0 for each in record.recordings)
    finding = f"The fit leaves at most {100 * left:.2g} % unexplained."
    with rc_context(STYLE):
        figure = _figure(found, record)
    picture, shown = svg(figure, name), [Shown(name, "Recorded and fitted", finding, put(words("identified")), figure)]
    page = (
        templates()
        .get_template("identification.html.j2")
        .render(
            record=record,
            figures=figure_entries(shown, {name: picture}),
            sentence=f"{len(record.numbers)} parameters, each with a range that the proof covers. {said}",
            between=lambda each: str(span(each.low, each.high, each.unit)),
            text=device_text(record),
        )
    )
    return {folder / f"{name}.svg": picture, folder / REPORT: page}


def _figure(found: Identified, record: IdentificationRecord) -> Figure:
    heights = [1.8, 1.2] * sum(study.curves is not None for study in found.studies)
    shown = [(study, study.lines[0]) for study in found.studies if study.lines and study.lines[0].hertz.size]
    heights += [2.4] * len(shown) + [0.34 * len(record.numbers) + 0.4]
    figure = canvas(WIDTH, sum(heights) + 0.6 * len(heights), left=1.5, top=0.35, gaps=(0.0, 0.62))
    panels = iter(np.atleast_1d(figure.subplots(len(heights), 1, height_ratios=heights)))
    for study in found.studies:
        if study.curves is not None:
            names = record.units.force_name, record.units.force
            names = ("position", record.units.position) if study.quantity == "motion" else names
            _in_time(next(panels), next(panels), study.curves, study.recording.name, *names)
    for study, lines in shown:
        axes, units = next(panels), record.units
        _response(axes, lines, found, study.recording.name)
        over = study.quantity == "motion"
        axes.set_ylabel("measured / commanded" if over else f"position / {units.force_name},\n{units.compliance}")
    _numbers(next(panels), record)
    return figure


def _in_time(close: Axes, whole: Axes, curves: Curves, name: str, quantity: str, unit: str) -> None:
    """Draw signal and fit where they differ most, and the difference over the whole log."""
    left = curves.measured - curves.fitted
    first = int(np.clip(np.argmax(np.abs(left)) - WINDOW // 2, 0, max(left.size - WINDOW, 0)))
    rows, every = slice(first, first + WINDOW), max(1, left.size // MOST_POINTS)
    drawn, prefixed = in_prefixed(np.stack([curves.measured[rows], curves.fitted[rows]]), unit)
    close.plot(curves.time[rows], drawn[0], color=BLUE, label=f"recorded, {name}")
    close.plot(curves.time[rows], drawn[1], "--", color=ORANGE, label="fit")
    close.set(ylabel=f"{quantity}, {prefixed}", xlabel="time, s")
    legend_above(close, 2)
    remaining, prefixed = in_prefixed(left[::every], unit)
    whole.plot(curves.time[::every], remaining, color=GREY, linewidth=0.8)
    whole.set(ylabel=f"residual, {prefixed}", xlabel="time, s")


def _response(axes: Axes, lines: Lines, found: Identified, name: str) -> None:
    size, record = np.abs(lines.ratio), found.record
    if len(record.unmodelled) > 1:
        low, high = covered(lines, found.device, record.numbers, record.unmodelled)
        axes.fill_between(lines.hertz, low, high, color=GREY, alpha=0.25, label="box and unmodelled")
    bars = np.minimum(2 * lines.spread, 0.99) * size
    axes.errorbar(lines.hertz, size, bars, fmt=".", color=BLUE, markersize=3, elinewidth=0.7, label=name)
    axes.plot(lines.hertz, np.abs(lines.fitted), color=ORANGE, linewidth=1.0, label="fit")
    decades(axes)
    frequency_axis(axes, 0.9 * float(lines.hertz[0]), 1.1 * float(lines.hertz[-1]))
    legend_above(axes, 3)


def _numbers(axes: Axes, record: IdentificationRecord) -> None:
    for row, each in enumerate(record.numbers):
        ends = np.array([each.low, each.high]) / each.value - 1
        label = "" if row else "box"
        axes.barh(row, 100 * np.ptp(ends), left=100 * ends[0], height=0.5, color=GREY, alpha=0.35, label=label)
        places = np.linspace(-0.15, 0.15, len(each.estimates)) if len(each.estimates) > 1 else [0.0]
        for place, one in zip(places, each.estimates, strict=True):
            label = "found ± 2σ" if row == 0 and place == places[0] else ""
            sigma, off = 200 * (one.sigma or 0.0) / each.value, 100 * (one.value / each.value - 1)
            axes.errorbar(off, row + place, xerr=sigma, fmt="o", color=BLUE, markersize=4, label=label)
    axes.set_yticks(range(len(record.numbers)), [each.key for each in record.numbers], fontsize=7.5)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(-110, 110)
    axes.set_xticks([-100, -10, -1, 0, 1, 10, 100], ["−100", "−10", "−1", "0", "1", "10", "100"], fontsize=7.5)
    axes.set_xlabel("off the middle of the box, %")
    legend_above(axes, 2)
