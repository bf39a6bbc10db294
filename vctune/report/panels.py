"""Draw the curves of a design on the axes of a report, or on your own axes."""

from __future__ import annotations

from math import cos, degrees, inf, log10, pi, sin

import numpy as np
from matplotlib.axes import Axes

from vctune.analysis.feel import NO_LOOP, sensor_miss
from vctune.analysis.felt_impedance import impedance_felt
from vctune.analysis.margins import loop_margins
from vctune.analysis.responses import Loop
from vctune.document.reading import ProblemFile
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.report.curves import Required, handle_impedance, no_coupling, requirements, transparency
from vctune.report.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    RED,
    frequency_axis,
    in_place,
    limit,
    logarithmic,
    shade,
)

SHALLOW = 1e-9  # Least shown value as a share of the top of the axis; at Nyquist R may vanish
LEAST_SPAN = 0.1  # Least span of ratios that sets the limits of the axis
THIN = ((RED, "--"), (INK, ":"), (GREY, "-."))  # Colours and dashes of further requirements


def _posed(source: Problem | ProblemFile) -> Problem:
    return source.problem if isinstance(source, ProblemFile) else source


def draw_required(
    axes: Axes, problem: Problem | ProblemFile, gains: Gains, coupling: AnyCoupling, requirement: Required | None = None
) -> Axes:
    """Draw Re Z_c of the coupling and the R that the hands require, over frequency.

    For an impedance display, the function draws Re 1/Z_c. The curve of R is for the worst hand and device of the
    problem at each frequency; thin curves show R of single hands or devices.

    Parameters
    ----------
    axes : Axes
        Axes of Matplotlib.
    problem : Problem or ProblemFile
        The problem, also as `problem` returns it.
    gains, coupling : Gains and AnyCoupling
        The design.
    requirement : Required, optional
        Which requirement to draw; by default the first of the problem.

    Returns
    -------
    Axes
        The given axes.
    """
    problem = _posed(problem)
    drawn = requirement or requirements(problem, gains, coupling)[0]
    axes.semilogy(drawn.hz, drawn.offered, color=BLUE, label=f"coupling, {drawn.name}")
    axes.semilogy(drawn.hz, drawn.required, "--", color=ORANGE, label="required, R")
    for (name, values), (colour, dashes) in zip(drawn.others.items(), THIN, strict=False):
        axes.semilogy(drawn.hz, values, dashes, linewidth=0.9, color=colour, label=name)
    axes.set_ylabel(f"{'conductance' if problem.device.kind.inverse else 'resistance'}, {drawn.unit}")
    _frequencies(axes, drawn)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, SHALLOW * high), high)
    logarithmic(axes)
    return axes


def draw_ratio(
    axes: Axes, problem: Problem | ProblemFile, gains: Gains, coupling: AnyCoupling, requirement: Required | None = None
) -> Axes:
    """Draw Re Z_c / R over frequency, on an axis around 1, with its least value and the safety factor.

    Parameters
    ----------
    axes : Axes
        Axes of Matplotlib.
    problem : Problem or ProblemFile
        The problem, also as `problem` returns it.
    gains, coupling : Gains and AnyCoupling
        The design.
    requirement : Required, optional
        Which requirement to draw; by default the first of the problem.

    Returns
    -------
    Axes
        The given axes.
    """
    problem = _posed(problem)
    drawn, factor = requirement or requirements(problem, gains, coupling)[0], problem.stability.safety_factor
    axes.plot(drawn.hz, drawn.offered / drawn.required, color=BLUE, label=f"{drawn.name} / R")
    axes.axhline(1.0, color=RED, linewidth=1.2, linestyle="-.", label="1: the limit")
    axes.axhline(factor, color=INK, linewidth=1, linestyle=":", label=f"safety factor {factor:g}")
    marks = [1.0, factor]
    if drawn.min_ratio is not None:  # an extremum at 0 or for high frequencies stands at the edge of the axis
        at = np.clip(inf if drawn.worst_hz is None else drawn.worst_hz, drawn.hz[0], drawn.hz[-1])
        least, label = max(drawn.min_ratio, 0.0), f"least: {in_place(drawn.min_ratio, drawn.worst_hz)}"
        axes.plot(at, least, "o", color=RED, label=label, clip_on=False)
        marks.append(min(least, 2 * factor))
    low, span = min(marks), max(max(marks) - min(marks), LEAST_SPAN)
    axes.set(ylim=(max(low - 0.9 * span, 0.0), max(marks) + 2.6 * span), ylabel="coupling / required")
    _frequencies(axes, drawn)
    return axes


def _frequencies(axes: Axes, drawn: Required) -> None:
    frequency_axis(axes, drawn.hz[0], drawn.hz[-1])
    if drawn.band is not None:
        shade(axes, drawn.band, BLUE, "requested band")


def draw_nyquist(axes: Axes, problem: Problem | ProblemFile, gains: Gains) -> Axes:
    """Draw the sampled velocity loop L up to Nyquist, its margins, and the circle in which ``|S|`` exceeds its limit.

    Parameters
    ----------
    axes : Axes
        Axes of Matplotlib.
    problem : Problem or ProblemFile
        A problem with a velocity loop, so not of a servo.
    gains : Gains
        Gains of the velocity loop.

    Returns
    -------
    Axes
        The given axes.
    """
    problem = _posed(problem)
    most, curve = problem.stability.max_sensitivity, Loop(problem.device, gains).L.at()
    margins = loop_margins(problem.device, gains)
    axes.plot(curve.values.real, curve.values.imag, color=BLUE, label="L up to Nyquist")
    angle = np.linspace(0, 2 * pi, 181)
    axes.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=1, linestyle="--", label="unit circle")
    circle = axes.fill(-1 + np.cos(angle) / most, np.sin(angle) / most, label=f"|S| > {most:g}")[0]
    circle.set(facecolor="none", edgecolor=RED, hatch="///", linewidth=1)
    axes.plot(-1, 0, "+", color=RED, markersize=10, label="-1")
    if margins.gain < inf:
        label = f"gain margin {limit(20 * log10(margins.gain), 'dB', 3)}"
        axes.plot(-1 / margins.gain, 0, "o", color=ORANGE, label=label)
    if margins.phase < inf:
        label = f"phase margin {limit(degrees(margins.phase), 'deg', 3)}"
        axes.plot(-cos(margins.phase), -sin(margins.phase), "s", color=GREEN, label=label)
    axes.set(xlim=(-1.2 - 1 / most, 1.1), ylim=(-1.1, 1.1), aspect="equal")
    axes.set(xlabel="Re L, dimensionless", ylabel="Im L, dimensionless")
    return axes


def draw_error(
    axes: Axes, problem: Problem | ProblemFile, gains: Gains, coupling: AnyCoupling, part: str = "error"
) -> Axes:
    """Draw the transparency error or one of its terms over frequency, for a design.

    For an admittance display, the function also draws it without a coupling, and without a coupling and a loop. For
    the term "tracking", it also draws what the force sensor alone loses, which no gain affects.

    Parameters
    ----------
    axes : Axes
        Axes of Matplotlib.
    problem : Problem or ProblemFile
        The problem, also as `problem` returns it.
    gains, coupling : Gains and AnyCoupling
        The design.
    part : str
        "error", or a term: "admittance", "tracking" or "coupling".

    Returns
    -------
    Axes
        The given axes.
    """
    problem = _posed(problem)
    hz, designed = transparency(problem, gains, coupling)
    cases = [("designed", designed, "-", BLUE)]
    if problem.device.kind.banded:
        cases.append(("no coupling", transparency(problem, gains, no_coupling(problem))[1], "--", GREY))
        cases.append(("uncontrolled", transparency(problem, Gains(0.0, 0.0), no_coupling(problem))[1], ":", GREY))
    for name, curves, dashes, colour in cases:
        if curves[part].max() > 1e-12:  # a term that is 0 has no place on a logarithmic axis
            axes.semilogy(hz, curves[part], dashes, color=colour, label=name, zorder=3 if colour == BLUE else 2)
    if part == "tracking" and (miss := sensor_miss(problem.device, 2 * pi * hz)) is not None:
        label = f"{problem.units.force_name} sensor, |1 - F_s|"
        axes.semilogy(hz, miss, "-.", linewidth=1.2, color=ORANGE, label=label)
    frequency_axis(axes, hz[0], hz[-1])
    shade(axes, problem.transparency.band, BLUE, "transparency band")
    axes.set_ylabel("transparency error" if part == "error" else f"term of the error: {part}")
    logarithmic(axes)
    return axes


def draw_impedance(axes: Axes, problem: Problem | ProblemFile, gains: Gains, coupling: AnyCoupling) -> Axes:
    """Draw the impedance that the hand feels with several environments, and the ideal one, over frequency.

    For a device with a mechanism, that is, not a servo, the function also draws the bare device.

    Parameters
    ----------
    axes : Axes
        Axes of Matplotlib.
    problem : Problem or ProblemFile
        The problem, also as `problem` returns it.
    gains, coupling : Gains and AnyCoupling
        The design.

    Returns
    -------
    Axes
        The given axes.
    """
    problem = _posed(problem)
    hz, felt = handle_impedance(problem, gains, coupling)
    for number, (name, (impedance, ideal)) in enumerate(felt.items()):
        colour, every, dashes = (BLUE, GREEN, ORANGE, RED)[number], (0.025 * number, 0.1), ("", "--", "-.", "")[number]
        axes.semilogy(hz, impedance, marker="os^D"[number], markevery=every, markersize=4, color=colour, label=name)
        if np.isfinite(ideal).all() and ideal.max() > 0:
            label = "_" if number > 1 else "ideal"
            axes.semilogy(hz, ideal, color=colour, linewidth=1, linestyle=dashes, label=label)
    if problem.device.servo is None:
        bare = np.abs(impedance_felt(problem.device, *NO_LOOP, 2 * pi * hz, None))
        axes.semilogy(hz, bare, ":", color=GREY, linewidth=1.2, label="bare device")
    frequency_axis(axes, hz[0], hz[-1])
    axes.set_ylabel(f"impedance at the handle, {problem.units.damping}")
    logarithmic(axes)
    return axes
