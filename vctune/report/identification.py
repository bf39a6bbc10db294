"""The page of an identification: force over time, response, residual, and each number with its interval."""

from __future__ import annotations

from math import ceil, pi, sqrt
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.document.recording import Floats
from vctune.document.records.identification_json import IdentificationRecord, device_text
from vctune.identification.identify import Identified
from vctune.identification.motion.motion_study import MotionStudy
from vctune.identification.record_study import RecordStudy
from vctune.identification.response.periodic_study import PeriodicStudy, behind_force
from vctune.identification.response.unmodelled import covered
from vctune.model.numbers.units import Units
from vctune.report.design_figures import Shown
from vctune.report.page import figure_entries, templates
from vctune.report.paths import REPORT
from vctune.report.servo_figures import following, servo_response
from vctune.report.style import (
    BLUE,
    GREEN,
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
from vctune.report.typography import span

WINDOW = 2.0  # Length, s, of the part of the log that the figure enlarges
MOST_POINTS = 2000  # Greatest number of drawn points of a log, up to a factor of 2
SPECTRUM_BINS = 120  # Number of edges of the bands of a spectrum, which have equal widths on a log scale

# Title of each figure and a text that explains it, by the name of the figure
READINGS = {
    "time-fit": (
        "Force in time",
        "The upper panel shows the recorded force, and the force that mass and friction need for the motion, where the "
        "difference is largest. The lower panel shows the difference over the whole log.",
    ),
    "following": (
        "How the servo follows",
        "The upper panel shows commanded position, measured position and fit, where the fit is worst. The "
        "lower panel shows the difference over the whole log. A velocity that arrives early or late shifts the "
        "position permanently.",
    ),
    "response": (
        "Response",
        "The panels show measured lines or bands with twice their standard deviation, and the fit. The grey area is "
        "the box with the unmodelled disc. It contains every measured magnitude. The box does not include dry "
        "friction, which shifts the phase of slow lines out of it. The lower panel shows how well each line repeats.",
    ),
    "residual-spectrum": (
        "The residual",
        "The curve shows the power of the residual over frequency. The dashed line is the noise of the encoder "
        "alone. Power above it is model error, and the intervals allow for it.",
    ),
    "numbers": (
        "Each parameter and what limits it",
        "Dots are single records and directions with twice their standard deviation. The bar is the box, relative to "
        "its middle.",
    ),
}


def identification_files(found: Identified, record: IdentificationRecord, folder: Path) -> dict[Path, str]:
    """Return the figures and the report of an identification. The page is the last file."""
    said, put, shown = _findings(record), record.units.translated, list[Shown]()
    for name, figure in _figures(found, record).items():
        title, reading = READINGS[name]
        shown.append(Shown(name, put(title), put(said.get(name, "")), put(reading), figure))
    pictures = {each.name: svg(each.figure, each.name) for each in shown}
    page = (
        templates()
        .get_template("identification.html.j2")
        .render(
            record=record,
            figures=figure_entries(shown, pictures),
            sentence=f"{len(record.numbers)} parameters, each with a range that the proof covers. {said['numbers']}",
            between=lambda each: str(span(each.low, each.high, each.unit)),
            text=device_text(record),
        )
    )
    return {**{folder / f"{name}.svg": text for name, text in pictures.items()}, folder / REPORT: page}


def _findings(record: IdentificationRecord) -> dict[str, str]:
    """Return a sentence about each figure, by the figure's name."""
    widest = max(record.numbers, key=lambda each: each.share)
    between = span(widest.low, widest.high, widest.unit)
    found = {"numbers": f"{widest.key} has the widest range: {between}, ± {100 * widest.share:.2g} %."}
    shares = [each.residual_share for each in record.recordings if each.residual_share is not None]
    if shares:
        left = f"The fit leaves at most {100 * max(shares):.2g} % unexplained."
        found |= dict.fromkeys(("time-fit", "following", "response"), left)
    noise = [each.chi2 for each in record.recordings if each.chi2 is not None]
    if noise:
        found["residual-spectrum"] = (
            f"The residual is {sqrt(max(noise)):.2g} times as large as the noise alone would make it."
        )
    return found


def _figures(found: Identified, record: IdentificationRecord) -> dict[str, Figure]:
    figures = {}
    moved = [study for study in found.records if study.motion is not None]
    repeated = [study for study in found.records if study.periodic is not None]
    followed = [study for study in found.records if study.servo is not None]
    with rc_context(STYLE):
        if moved:
            figures["time-fit"] = _time_fit(moved, record.units)
        if repeated:
            figures["response"] = _response(found, repeated, record.units)
        if followed:
            figures["following"] = following(followed, record.units)
            shown = [study for study in followed if study.measured_hz.size]
            if shown and found.unmodelled:
                figures["response"] = servo_response(found, shown)
        if moved or repeated:
            figures["residual-spectrum"] = _residual_spectra([*moved, *repeated], record.units)
        figures["numbers"] = _numbers(record)
    return figures


def _time_fit(studies: list[RecordStudy], units: Units) -> Figure:
    figure = canvas(WIDTH, 3.7 * len(studies), left=0.75, top=0.35, gaps=(0.0, 0.62))
    axes = np.atleast_1d(figure.subplots(2 * len(studies), 1))
    for (close, whole), study in zip(axes.reshape(-1, 2), studies, strict=True):
        assert study.motion is not None
        fit = study.motion.samples
        left = fit.left
        worst = fit.time[int(np.argmax(np.abs(left)))]
        shown = np.abs(fit.time - worst) < WINDOW / 2
        close.plot(fit.time[shown], fit.measured[shown], color=BLUE, label=f"recorded, {study.recording.name}")
        close.plot(fit.time[shown], fit.fitted[shown], "--", color=ORANGE, label=units.translated("mass and friction"))
        close.set(ylabel=f"{units.force_name}, {units.force}", xlabel="time, s")
        legend_above(close, 2)
        every = max(1, left.size // MOST_POINTS)
        remaining, unit = in_prefixed(left[::every], units.force)
        whole.plot(fit.time[::every], remaining, color=GREY, linewidth=0.8)
        whole.set(ylabel=f"residual, {unit}", xlabel="time, s")
    return figure


def _response(found: Identified, studies: list[RecordStudy], units: Units) -> Figure:
    figure = canvas(WIDTH, 5.0, left=0.75, top=0.35, gaps=(0.0, 0.12))
    size, phase, repeat = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 1])
    colours = (BLUE, GREEN, ORANGE, GREY)
    for study, colour in zip(studies, colours * len(studies), strict=False):
        periodic = study.periodic
        assert periodic is not None
        _lines(size, phase, repeat, periodic, colour, study.recording.name)
    first = studies[0].periodic
    assert first is not None
    omega = first.measured.position.omega
    hertz = omega / (2 * pi)
    device, bounds = behind_force(first, studies[0].sample_time, found.device, found.bounds)
    allowed = covered(device, bounds, found.unmodelled, omega, is_command=first.measured.input == "command")
    size.fill_between(hertz, allowed[0], allowed[1], color=GREY, alpha=0.25, label="box and unmodelled")
    phase.fill_between(hertz, allowed[2], allowed[3], color=GREY, alpha=0.25)
    size.set_ylabel(f"position / {units.force_name}, {units.compliance}")
    decades(size)
    phase.set_ylabel("phase, degrees")
    repeat.set(ylabel="coherence", ylim=(0, 1.05))
    frequency_axis(repeat, 0.9 * float(hertz[0]), 1.1 * float(hertz[-1]))
    legend_above(size, 3)
    return figure


def _lines(size: Axes, phase: Axes, repeat: Axes, periodic: PeriodicStudy, colour: str, name: str) -> None:
    lines, model = periodic.measured.position, periodic.fit.position
    hertz = lines.omega / (2 * pi)
    amplitude = np.abs(lines.ratio)
    bars = np.minimum(2 * lines.spread, 0.99) * amplitude
    size.errorbar(hertz, amplitude, bars, fmt=".", color=colour, markersize=3, elinewidth=0.7, label=name)
    size.plot(hertz, np.abs(model), color=colour, linewidth=1.0, label="fit")
    phase.plot(hertz, _degrees(lines.ratio), ".", color=colour, markersize=3)
    phase.plot(hertz, _degrees(model), color=colour, linewidth=1.0)
    repeat.plot(hertz, lines.coherence, ".", color=colour, markersize=3)


def _degrees(response: np.ndarray) -> Floats:
    return np.degrees(np.unwrap(np.angle(-response))) - 180.0


def _residual_spectra(studies: list[RecordStudy], units: Units) -> Figure:
    figure = canvas(WIDTH, 2.6, left=0.75, top=0.35)
    axes = figure.subplots()
    ends = []
    for study, colour in zip(studies, (BLUE, GREEN, ORANGE, GREY) * len(studies), strict=False):
        hertz, power, noise = _motion_left(study, study.motion) if study.motion is not None else _lines_left(study)
        axes.plot(
            hertz, power, ".-" if study.periodic else "-", color=colour, linewidth=1.0, label=study.recording.name
        )
        axes.plot(hertz, noise, "--", color=colour, linewidth=1.0, label="noise")
        ends += [float(hertz[0]), float(hertz[-1])]
    axes.set_ylabel(f"residual, share of the {units.force_name}")
    decades(axes)
    frequency_axis(axes, min(ends), max(ends))
    legend_above(axes, 2 if len(studies) == 1 else 3)
    return figure


def _motion_left(study: RecordStudy, motion: MotionStudy) -> tuple[Floats, Floats, Floats]:
    """Return frequencies, Hz, and the root mean squares of the residual and of the encoder's noise around them."""
    fit, samples = motion.directional, motion.samples
    T = samples.step
    whole = np.zeros(ceil(fit.samples[1] * study.sample_time / T * (1 - 1e-12)))
    whole[samples.rows] = samples.left
    spectrum = 2 * np.abs(np.fft.rfft(whole)) ** 2 / whole.size**2
    f = np.asarray(np.fft.rfftfreq(whole.size, T), dtype=np.float64)
    edges = np.exp(np.linspace(np.log(f[2]), np.log(min(3 * fit.cutoff_hz, 0.5 / T)), SPECTRUM_BINS))
    place = np.digitize(f, edges)
    found = [i for i in range(1, edges.size) if np.any(place == i)]
    power = np.array([np.sqrt(spectrum[place == i].sum()) for i in found]) / fit.force
    middle = np.array([np.sqrt(edges[i - 1] * edges[i]) for i in found])
    each = motion.encoder_noise(f, study.sample_time) / fit.force
    noise = np.array([np.sqrt(np.sum(each[place == i] ** 2)) for i in found])
    return middle, np.maximum(power, 1e-12), np.maximum(noise, 1e-12)


def _lines_left(study: RecordStudy) -> tuple[Floats, Floats, Floats]:
    periodic = study.periodic
    assert periodic is not None
    lines = periodic.measured.position
    return lines.omega / (2 * pi), np.maximum(periodic.left, 1e-12), np.maximum(lines.spread, 1e-12)


def _numbers(record: IdentificationRecord) -> Figure:
    figure = canvas(WIDTH, 0.34 * len(record.numbers) + 0.9, left=1.6, top=0.35)
    axes = figure.subplots()
    for row, each in enumerate(record.numbers):
        low, high = each.low / each.value - 1, each.high / each.value - 1
        axes.barh(
            row, 100 * (high - low), left=100 * low, height=0.5, color=GREY, alpha=0.35, label="" if row else "box"
        )
        places = np.linspace(-0.15, 0.15, len(each.estimates)) if len(each.estimates) > 1 else [0.0]
        for place, one in zip(places, each.estimates, strict=True):
            sigma = 200 * (one.sigma or 0.0) / each.value
            axes.errorbar(
                100 * (one.value / each.value - 1), row + place, xerr=sigma, fmt="o", color=BLUE, markersize=4,
                label="found, twice the standard deviation" if row == 0 and place == places[0] else "",
            )  # fmt: skip
    axes.set_yticks(range(len(record.numbers)), [each.key for each in record.numbers], fontsize=7.5)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(-110, 110)
    axes.set_xticks([-100, -10, -1, 0, 1, 10, 100], ["−100", "−10", "−1", "0", "1", "10", "100"], fontsize=7.5)
    axes.set_xlabel("off the middle of the box, %")
    legend_above(axes, 2)
    return figure
