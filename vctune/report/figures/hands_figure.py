"""The requirement of a box of hands or of any passive hand up to Nyquist, and each hand's share of the resistance."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import inf, nan, pi
from typing import NamedTuple

import numpy as np
from contourpy import FillType, contour_generator

from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import RatioInHand, least_ratios_in_any_hand, least_ratios_in_hands
from vctune.analysis.loops_in_hands import loops_in_any_hand, loops_in_hands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.frequency import hertz
from vctune.model.numbers.units import UNITS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, offered, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.report.figures.style import WIDTH, around_one, decades, frequency_axis
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import BLUE, GREY, INK, ORANGE, PAPER, RED, path, text
from vctune.report.svg.labels import label_curves
from vctune.report.svg.panel import Axes, Panel

ANGLES_OF_CURVES = 40  # Number of angles per decade of the curves
# Number of masses and of stiffnesses of the map, and shares of the range of dampings
GRID_OF_MAP, DAMPINGS = 17, (0.0, 0.1, 1.0)
LEAST_ANGLE, ANGLES_OF_MAP = 1e-3, 24  # Least angle, rad, and number of angles per decade of the map
LEVELS = (0, 20, 40, 60, 70, 80, 90, 95, 100, 120)  # Levels of the map, %, which are closer near the limit of 100 %
# Colours of the map cividis, which is readable in grey and with every kind of colour vision
COLOURS = "#003170", "#434e6c", "#6a6c71", "#868379", "#9b9476", "#b0a571", "#c1b26a", "#cdbb63", "#e9d34e"
SCALE_WIDTH = 62.0  # Room for the legend of the colours, to the right of the map, points
# Least shown value as a share of the top of the axis, which is the greatest of Re Z_c and R; at Nyquist R may vanish
SHALLOW = 1e-9
WORST = 3  # Number of hands with a curve of their own


class OfferedAndRequired(NamedTuple):
    """The resistance of a coupling, and the resistance that the hands of a box require, up to Nyquist."""

    hz: Floats  # frequencies, Hz, and omega T, rad; one entry for each angle above 0, as in `offered` and `required`
    theta: Floats
    offered: Floats  # Re Z_c as the firmware runs it, N s/m
    required: Floats  # greatest R of the hands, in the unit of `offered`; may be 0 or negative
    least: list[RatioInHand]  # least ratios in the hands, the lowest first


def offered_and_required(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    hands: Hands | None = None,
    least: list[RatioInHand] | None = None,
) -> OfferedAndRequired:
    """Return the curves that `draw_required_in_hands` and `draw_ratio_in_hands` draw."""
    device, hands = problem.device, hands or problem.hands
    loops = loops_in_hands(device, hands, per_decade=ANGLES_OF_CURVES)
    positive = loops.theta > 0
    theta = loops.theta[positive]
    ratios = least or least_ratios_in_hands(device, hands, gains, coupling)
    required = loops.required(gains)[:, positive].max(axis=0)
    hz = theta / (2 * pi * device.sample_time)
    return OfferedAndRequired(hz, theta, offered(coupling, device, theta, FLOATS), required, ratios)


def hands_figure(
    problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling, least: list[RatioInHand] | None = None
) -> Drawing:
    """Draw Re Z_c against the R of the worst hands, their ratio, and a map of the greatest R/Re Z_c of each hand."""
    mapped = hands.low.mass < hands.high.mass and hands.low.stiffness < hands.high.stiffness
    drawing = Drawing(WIDTH, 5.55 if mapped else 4.6, left=0.8, top=0.45)
    panels = drawing.divide(3, 1, (0, 0.45), (5, 4, 4)) if mapped else drawing.divide(2, 1, (0, 0.42), (3, 2))
    upper, ratio = panels[:2]
    curves = offered_and_required(problem, gains, coupling, hands, least)
    draw_required_in_hands(upper, problem, gains, coupling, curves)
    upper.set(xlabel="")
    draw_ratio_in_hands(ratio, problem, gains, coupling, curves)
    label_curves(ratio)
    label_curves(upper, 1)
    if mapped:
        _map(panels[2], problem, hands, gains, coupling, curves.least[0].hand)
    return drawing


def draw_required_in_hands(
    axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, curves: OfferedAndRequired | None = None
) -> Axes:
    """Draw Re Z_c of the coupling as the firmware runs it, the greatest R of the hands, and R of the worst hands.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its hands
    gains, coupling : the design
    curves : curves of the design (`offered_and_required`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    curves, device = curves or offered_and_required(problem, gains, coupling), problem.device
    scale, shown = _shown_as(device, curves.theta), list[Hand]()
    axes.semilogy(curves.hz, scale * curves.offered, color=BLUE, label=f"coupling, {_name(device)}")
    axes.semilogy(curves.hz, scale * _positive(curves.required), color=ORANGE, label="required R, and in hands of:")
    for worst in curves.least:
        if worst.hand not in shown and len(shown) < WORST:
            shown.append(worst.hand)
            loops = loops_in_hands(device, Hands(worst.hand, worst.hand), per_decade=ANGLES_OF_CURVES)
            required = loops.required(gains)[0, loops.theta > 0]
            colour, line = ((RED, "--"), (INK, ":"), (GREY, "-."))[len(shown) - 1]
            label = worst.hand.in_words(problem.units)
            axes.semilogy(
                curves.hz, scale * _positive(required), linewidth=0.9, color=colour, linestyle=line, label=label
            )
    axes.set(ylabel=_axis(device))
    frequency_axis(axes, curves.hz[0], curves.hz[-1])
    low, high = axes.get_ylim()
    axes.set(ylim=(max(low, SHALLOW * high), high))
    decades(axes)
    return axes


def draw_ratio_in_hands(
    axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, curves: OfferedAndRequired | None = None
) -> Axes:
    """Draw Re Z_c / R in the worst hand of each frequency, up to Nyquist, on an axis around 1.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its hands
    gains, coupling : the design
    curves : curves of the design (`offered_and_required`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    curves, name = curves or offered_and_required(problem, gains, coupling), _name(problem.device)
    axes.plot(curves.hz, curves.offered / _positive(curves.required), color=BLUE, label=f"{name} / R")
    worst = curves.least[0]
    hand, ratio = worst.hand.in_words(problem.units), worst.ratio if worst.ratio < inf else None
    around_one(axes, problem.stability.safety_factor, ratio, hertz(worst.omega), hand)
    frequency_axis(axes, curves.hz[0], curves.hz[-1])
    return axes


def shares_required(device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling) -> tuple[Floats, Floats, Floats]:
    """Return the greatest R/Re Z_c over all angles and `DAMPINGS`, for a grid of the hands' masses and stiffnesses."""
    squares = np.linspace(0.0, 1.0, GRID_OF_MAP) ** 2
    positions = {"mass": squares, "damping": np.array(DAMPINGS), "stiffness": squares}
    numbers = {name: low + (high - low) * positions[name] for name, (low, high) in hands.ranges.items()}
    # axes: mass, damping, stiffness, angle
    grid = Hand(*(number[..., None] for number in np.meshgrid(*numbers.values(), indexing="ij")))
    theta = np.geomspace(LEAST_ANGLE, pi, int(ANGLES_OF_MAP * np.log10(pi / LEAST_ANGLE)))
    loop = loop_in_hand(plant_in_hand(device, grid, delays_of(device), FLOATS), theta, FLOATS)
    required = required_in_hand(loop, gains)
    given = offered(coupling, device, theta, FLOATS)
    needed = (required.lost / required.size / np.maximum(given, 1e-300)).max(axis=(1, 3)).T
    return numbers["mass"], numbers["stiffness"], needed


def _map(panel: Panel, problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling, worst: Hand) -> None:
    """Draw the shares of `shares_required` as percentages, and mark the worst hand."""
    device, units = problem.device, problem.units
    mass, stiffness, needed = shares_required(device, hands, gains, coupling)
    left, top, width, height = panel.box
    panel.box, panel.grid = (left, top, width - SCALE_WIDTH, height), False
    panel.set(xlim=(mass[0], mass[-1]), ylim=(stiffness[0], stiffness[-1]))
    for level, colour in zip(LEVELS, COLOURS, strict=False):
        for x, y in _regions(mass, stiffness, 100 * np.clip(needed, 0.0, 1.2), level):
            panel.fill(x, y, facecolor=colour, linewidth=0)
    _scale(panel, f"R, % of {_name(device)}")
    panel.plot(worst.mass, worst.stiffness, "o", color=RED, markeredgecolor=PAPER, markersize=7, clip_on=False)
    panel.set(
        xlabel=f"{units.mass_name} of the hand, {units.mass}; dot: the worst", ylabel=f"stiffness, {units.stiffness}"
    )


def _regions(mass: Floats, stiffness: Floats, percent: Floats, level: float) -> Iterator[tuple[Floats, Floats]]:
    """Yield the borders of the regions of a map from a level upwards, as x and y with nan after each closed line."""
    lines = contour_generator(mass, stiffness, percent, fill_type=FillType.OuterOffset)
    lowest = level or -1.0  # a region of contourpy excludes values equal to its lower level
    for corners, starts in zip(*lines.filled(lowest, np.inf), strict=True):
        x, y = np.concatenate([(*part, (nan, nan)) for part in np.split(corners, starts[1:-1])]).T
        yield x, y


def _scale(panel: Panel, label: str) -> None:
    """Draw the legend of the map's colours to the right of the map."""
    left, top, width, height = panel.box
    x, wide = left + width + 12, 9.0
    y = np.linspace(top + height, top, len(LEVELS))
    for (low, high), colour in zip(pairwise(y), COLOURS, strict=True):
        panel.over.append(path(f"M{x} {low:.1f}h{wide}V{high:.1f}h-{wide}z", fill=colour))
    panel.over += [text(x + wide + 4, at, str(level), va="center") for at, level in [*zip(y, LEVELS, strict=True)][::2]]
    panel.over.append(text(x + wide + 32, top + height / 2, label, ha="center", va="center", rotation=90))


def any_hand_figure(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Drawing:
    """Draw Re 1/Z_c of an impedance display against the R of any passive hand, and their ratio, up to Nyquist."""
    device = problem.device
    loops = loops_in_any_hand(device, ANGLES_OF_CURVES)
    positive = loops.theta > 0
    theta = loops.theta[positive]
    hz, required = theta / (2 * pi * device.sample_time), loops.required(gains)[0, positive]
    given, scale = offered(coupling, device, theta, FLOATS), _shown_as(device, theta)
    drawing = Drawing(WIDTH, 4.6, left=0.8, top=0.35)
    upper, lower = drawing.divide(2, 1, (0, 0.42), (3, 2))
    upper.semilogy(hz, scale * given, color=BLUE, label=f"coupling, {_name(device)}")
    upper.semilogy(hz, scale * _positive(required), "--", color=ORANGE, label="required, R")
    upper.set(ylabel=_axis(device))
    lower.plot(hz, given / _positive(required), color=BLUE, label=f"{_name(device)} / R")
    least = least_ratios_in_any_hand(device, gains, coupling)[0]
    around_one(lower, problem.stability.safety_factor, least.ratio if least.ratio < inf else None, hertz(least.omega))
    for panel in (upper, lower):
        frequency_axis(panel, hz[0], hz[-1])
    upper.set(xlabel="")
    decades(upper)
    label_curves(upper)
    label_curves(lower)
    return drawing


def _shown_as(device: Device, theta: Floats) -> Floats | float:
    """Return the factor by which the figure multiplies both curves: s^2 with s = sin(theta/2) for an impedance display,
    whose curves `offered` and R are divided by s^2; otherwise 1."""
    return np.sin(theta / 2) ** 2 if device.kind.inverse else 1.0


def _name(device: Device) -> str:
    """Return the name of the coupling's curve, such as "Re Z_c"."""
    return f"Re {device.kind.couples}"


def _axis(device: Device) -> str:
    """Return the label of the axis of the curves, with its unit."""
    quantity = "conductance" if device.kind.inverse else "resistance"
    return f"{quantity}, {device.kind.coupling_unit(UNITS[device.units])}"


def _positive(required: Floats) -> Floats:
    """Return the positive numbers for a logarithmic axis; nan in place of the others."""
    return np.where(required > 0, required, np.nan)
