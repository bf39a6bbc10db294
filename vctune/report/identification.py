"""The page of an identification, with one picture: recordings and fits, and each number with its interval."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.document.records.identification_json import Bounded, IdentificationRecord, device_text
from vctune.identification.identify import Identified
from vctune.identification.study import Lines, Study, covered
from vctune.report.paths import IDENTIFICATION_FIGURES
from vctune.report.style import (
    BLUE,
    GREY,
    ORANGE,
    STYLE,
    WIDTH,
    frequency_axis,
    legend_above,
    logarithmic,
    prefixed,
    quantity,
)
from vctune.report.templates import Shown, page_files, words

WINDOW = 600  # Greatest number of samples in the enlarged part of a log
MOST_POINTS = 2000  # Greatest number of drawn points of a log, up to a factor of 2


def identification_files(found: Identified, record: IdentificationRecord, folder: Path) -> dict[Path, str]:
    """Return the picture and the report of an identification. The page is the last file."""

    def between(number: Bounded) -> str:
        return str(quantity(number.low, number.unit, to=number.high))

    (name,) = IDENTIFICATION_FIGURES
    widest = max(record.numbers, key=lambda each: each.share)
    said = f"{widest.key} has the widest range: {between(widest)}, ± {100 * widest.share:.2g} %."
    left = max(each.residual_share or 0.0 for each in record.recordings)
    with rc_context(STYLE):
        figure = _figure(found, record)
    finding = f"The fit leaves at most {100 * left:.2g} % unexplained."
    shown = Shown(name, "Recorded and fitted", finding, words("identified"), figure)
    sentence = f"{len(record.numbers)} parameters, each with a range that the proof covers. {said}"
    values: dict[str, Any] = {"record": record, "sentence": sentence, "between": between, "text": device_text(record)}
    return page_files(folder, "identification.html.j2", [shown], record.units.translated, **values)


def _figure(found: Identified, record: IdentificationRecord) -> Figure:
    units, curved = record.units, [study for study in found.studies if study.curves is not None]
    shown = [(study, study.lines[0]) for study in found.studies if study.lines and study.lines[0].hertz.size]
    heights = [2.4, 1.8] * len(curved) + [3.0] * len(shown) + [0.34 * len(record.numbers) + 1.0]
    figure = Figure(figsize=(WIDTH, sum(heights)))
    panels = iter(np.atleast_1d(figure.subplots(len(heights), 1, height_ratios=heights)))
    for study in curved:
        quantity, unit = ("position", units.position)
        if "position" not in study.recording.channels:
            quantity, unit = "velocity", units.speed
        _in_time(next(panels), next(panels), study, quantity, unit)
    for study, lines in shown:
        axes = next(panels)
        _response(axes, lines, found, study.recording.name)
        over = "measured / commanded" if found.device.servo else f"position / {units.force_name},\n{units.compliance}"
        axes.set_ylabel(over)
    draw_numbers(next(panels), record)
    return figure


def _in_time(close: Axes, whole: Axes, study: Study, quantity: str, unit: str) -> None:
    """Draw signal and fit where they differ most, and the difference over the whole log."""
    curves = study.curves
    assert curves is not None, "studies with curves are drawn"
    left = curves.measured - curves.fitted
    first = int(np.clip(np.argmax(np.abs(left)) - WINDOW // 2, 0, max(left.size - WINDOW, 0)))
    rows, every = slice(first, first + WINDOW), max(1, left.size // MOST_POINTS)
    time, measured, fitted = (each[rows] for each in (curves.time, curves.measured, curves.fitted))
    power, named = prefixed(float(np.abs(measured).max(initial=0.0)), unit)
    close.plot(time, measured / 10.0**power, color=BLUE, label=f"recorded, {study.recording.name}")
    close.plot(time, fitted / 10.0**power, "--", color=ORANGE, label="fit")
    close.set(ylabel=f"{quantity}, {named}", xlabel="time, s")
    legend_above(close, 2)
    power, named = prefixed(float(np.abs(left[::every]).max(initial=0.0)), unit)
    whole.plot(curves.time[::every], left[::every] / 10.0**power, color=GREY, linewidth=0.8)
    whole.set(ylabel=f"residual, {named}", xlabel="time, s")


def _response(axes: Axes, lines: Lines, found: Identified, name: str) -> None:
    size, record = np.abs(lines.ratio), found.record
    if len(record.unmodelled) > 1:
        low, high = covered(lines, found.device, record.numbers, record.unmodelled)
        axes.fill_between(lines.hertz, low, high, color=GREY, alpha=0.25, label="box and unmodelled")
    bars = np.minimum(2 * lines.spread, 0.99) * size
    axes.errorbar(lines.hertz, size, bars, fmt=".", color=BLUE, markersize=3, elinewidth=0.7, label=name)
    axes.plot(lines.hertz, np.abs(lines.fitted), color=ORANGE, linewidth=1.0, label="fit")
    logarithmic(axes)
    frequency_axis(axes, 0.9 * float(lines.hertz[0]), 1.1 * float(lines.hertz[-1]))
    legend_above(axes, 3)


def draw_numbers(axes: Axes, record: IdentificationRecord) -> None:
    """Draw the box of each number, and what was found of it, in per cent off the middle of the box."""
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
