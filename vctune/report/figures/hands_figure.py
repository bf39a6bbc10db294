"""The requirement of a box of hands up to Nyquist, and each hand's share of the coupling's resistance."""

from __future__ import annotations

from itertools import pairwise
from math import nan, pi
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

CURVES = 40
"""Number of angles per decade of the curves. Half as many show corners; twice as many double the file."""
PLACES, DAMPINGS = 17, (0.0, 0.1, 1.0)
"""Number of masses and of stiffnesses of the map, and shares of the range of dampings. The map shows the worst of these
dampings."""
LOWEST, MAPPED = 1e-3, 24
"""Least angle, rad, and number of angles per decade of the map. With half as many the map is wrong by 2 % where it is
steepest, with twice as many by 0.1 %."""
LEVELS = (0, 20, 40, 60, 70, 80, 90, 95, 100, 120)
"""Levels of the map, %, which are closer near the limit of 100 %. Half or twice as many are no easier to read."""
COLOURS = "#003170", "#434e6c", "#6a6c71", "#868379", "#9b9476", "#b0a571", "#c1b26a", "#cdbb63", "#e9d34e"
"""Of cividis, which is read by every kind of sight and in grey."""
SCALE_WIDTH = 62.0
"""Room for what the colours mean, to the right of the map, points."""
SHALLOW = 1e-9
"""Least shown R as a share of the greatest R; at Nyquist R may vanish. Half or twice this share shows as many
decades."""
WORST = 3
"""Number of hands with a curve of their own. They are the hands with the lowest minima."""


class Met(NamedTuple):
    """The resistance of a coupling, and the resistance that the hands of a box require, up to Nyquist.

    Attributes
    ----------
    hz, theta : frequencies, Hz, and omega T, rad
    offered : Re Z_c as the firmware runs it; for an impedance display, Re 1/Z_c over s^2
    required : the greatest R of the hands
    least : the least ratios in the hands, the lowest first
    """

    hz: Floats
    theta: Floats
    offered: Floats
    required: Floats
    least: list[RatioInHand]


def met_in_hands(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    hands: Hands | None = None,
    least: list[RatioInHand] | None = None,
) -> Met:
    """Return the curves that `draw_required_in_hands` and `draw_ratio_in_hands` draw.

    Parameters
    ----------
    problem : problem with the device
    gains, coupling : the design
    hands : the hands; None for the problem's hands
    least : the least ratios in them with any passive environment; None to compute them
    """
    device, hands = problem.device, hands or problem.hands
    where = loops_in_hands(device, hands, per_decade=CURVES)
    some = where.theta > 0
    theta = where.theta[some]
    found = least or least_ratios_in_hands(device, hands, gains, coupling)
    required = where.required(gains)[:, some].max(axis=0)
    return Met(theta / (2 * pi * device.sample_time), theta, offered(coupling, device, theta, FLOATS), required, found)


def hands_figure(
    problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling, least: list[RatioInHand] | None = None
) -> Drawing:
    """Draw Re Z_c against the R of the worst hands, and a map of the share that they need over mass and stiffness.

    Parameters
    ----------
    problem : the device
    hands : hands of the claim
    gains, coupling : the design
    least : the least ratios in the hands, before passive environments; None to work them out

    Returns
    -------
    Drawing
    """
    drawing = Drawing(WIDTH, 5.55, left=0.8, top=0.45)
    curves, ratio, plane = drawing.divide(3, 1, (0, 0.45), (5, 4, 4))
    met = met_in_hands(problem, gains, coupling, hands, least)
    draw_required_in_hands(curves, problem, gains, coupling, met)
    curves.set(xlabel="")
    draw_ratio_in_hands(ratio, problem, gains, coupling, met)
    label_curves(ratio)
    label_curves(curves, 1)
    _map(plane, problem, hands, gains, coupling, met.least[0].hand)
    return drawing


def draw_required_in_hands(
    axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, met: Met | None = None
) -> Axes:
    """Draw Re Z_c of the coupling as the firmware runs it, the greatest R of the hands, and R of the worst hands.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its hands
    gains, coupling : the design
    met : curves of the design (`met_in_hands`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    met, device = met or met_in_hands(problem, gains, coupling), problem.device
    scale, shown = _shown_as(device, met.theta), list[Hand]()
    axes.semilogy(met.hz, scale * met.offered, color=BLUE, label=f"coupling, {_name(device)}")
    axes.semilogy(met.hz, scale * _positive(met.required), color=ORANGE, label="required R, and in hands of:")
    for worst in met.least:
        if worst.hand not in shown and len(shown) < WORST:
            shown.append(worst.hand)
            where = loops_in_hands(device, Hands(worst.hand, worst.hand), per_decade=CURVES)
            one = where.required(gains)[0, where.theta > 0]
            colour, line = ((RED, "--"), (INK, ":"), (GREY, "-."))[len(shown) - 1]
            label = worst.hand.in_words(problem.units)
            axes.semilogy(met.hz, scale * _positive(one), linewidth=0.9, color=colour, linestyle=line, label=label)
    axes.set(ylabel=_axis(device))
    frequency_axis(axes, met.hz[0], met.hz[-1])
    low, high = axes.get_ylim()
    axes.set(ylim=(max(low, SHALLOW * high), high))
    decades(axes)
    return axes


def draw_ratio_in_hands(
    axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, met: Met | None = None
) -> Axes:
    """Draw Re Z_c / R in the worst hand of each frequency, up to Nyquist, on an axis around 1.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its hands
    gains, coupling : the design
    met : curves of the design (`met_in_hands`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    met, name = met or met_in_hands(problem, gains, coupling), _name(problem.device)
    axes.plot(met.hz, met.offered / _positive(met.required), color=BLUE, label=f"{name} / R")
    worst = met.least[0]
    whose = worst.hand.in_words(problem.units)
    around_one(axes, problem.stability.safety_factor, worst.ratio, hertz(worst.omega), whose)
    frequency_axis(axes, met.hz[0], met.hz[-1])
    return axes


def _map(panel: Panel, problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling, worst: Hand) -> None:
    """Draw the greatest R/Re Z_c over all angles and dampings as a percentage, and mark the worst hand."""
    device, units, shares = problem.device, problem.units, np.linspace(0.0, 1.0, PLACES) ** 2
    places = {"mass": shares, "damping": np.array(DAMPINGS), "stiffness": shares}
    of = {name: low + (high - low) * places[name] for name, (low, high) in hands.ranges.items()}
    mass, stiffness = of["mass"], of["stiffness"]
    held = Hand(*(number[..., None] for number in np.meshgrid(*of.values(), indexing="ij")))
    theta = np.geomspace(LOWEST, pi, int(MAPPED * np.log10(pi / LOWEST)))
    loop = loop_in_hand(plant_in_hand(device, held, delays_of(device), FLOATS), theta, FLOATS)
    required = required_in_hand(loop, gains)
    Z_c = offered(coupling, device, theta, FLOATS)
    need = (required.lost / required.size / np.maximum(Z_c, 1e-300)).max(axis=(1, 3)).T
    left, top, width, height = panel.box
    panel.box, panel.grid = (left, top, width - SCALE_WIDTH, height), False
    panel.set(xlim=(mass[0], mass[-1]), ylim=(stiffness[0], stiffness[-1]))
    lines = contour_generator(mass, stiffness, 100 * np.clip(need, 0.0, 1.2), fill_type=FillType.OuterOffset)
    for level, colour in zip(LEVELS, COLOURS, strict=False):
        for corners, starts in zip(*lines.filled(level, np.inf), strict=True):
            x, y = np.concatenate([(*part, (nan, nan)) for part in np.split(corners, starts[1:-1])]).T
            panel.fill(x, y, facecolor=colour, linewidth=0)
    _scale(panel, f"R, % of {_name(device)}")
    panel.plot(worst.mass, worst.stiffness, "o", color=RED, markeredgecolor=PAPER, markersize=7, clip_on=False)
    panel.set(
        xlabel=f"{units.mass_name} of the hand, {units.mass}; dot: the worst", ylabel=f"stiffness, {units.stiffness}"
    )


def _scale(panel: Panel, label: str) -> None:
    """Draw what the colours of the map mean, to the right of it."""
    left, top, width, height = panel.box
    x, wide = left + width + 12, 9.0
    y = np.linspace(top + height, top, len(LEVELS))
    for (low, high), colour in zip(pairwise(y), COLOURS, strict=True):
        panel.over.append(path(f"M{x} {low:.1f}h{wide}V{high:.1f}h-{wide}z", fill=colour))
    panel.over += [text(x + wide + 4, at, str(level), va="center") for at, level in [*zip(y, LEVELS, strict=True)][::2]]
    panel.over.append(text(x + wide + 32, top + height / 2, label, ha="center", va="center", rotation=90))


def any_hand_figure(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Drawing:
    """Draw Re 1/Z_c of an impedance display against the R of any passive hand, and their ratio, up to Nyquist.

    Parameters
    ----------
    problem : the device
    gains, coupling : the design

    Returns
    -------
    Drawing
    """
    device = problem.device
    where = loops_in_any_hand(device, CURVES)
    some = where.theta > 0
    theta = where.theta[some]
    hz, required = theta / (2 * pi * device.sample_time), where.required(gains)[0, some]
    given, scale = offered(coupling, device, theta, FLOATS), _shown_as(device, theta)
    drawing = Drawing(WIDTH, 4.6, left=0.8, top=0.35)
    upper, lower = drawing.divide(2, 1, (0, 0.42), (3, 2))
    upper.semilogy(hz, scale * given, color=BLUE, label=f"coupling, {_name(device)}")
    upper.semilogy(hz, scale * _positive(required), "--", color=ORANGE, label="required, R")
    upper.set(ylabel=_axis(device))
    lower.plot(hz, given / _positive(required), color=BLUE, label=f"{_name(device)} / R")
    least = least_ratios_in_any_hand(device, gains, coupling)[0]
    around_one(lower, problem.stability.safety_factor, least.ratio, hertz(least.omega))
    for each in (upper, lower):
        frequency_axis(each, hz[0], hz[-1])
    upper.set(xlabel="")
    decades(upper)
    label_curves(upper)
    label_curves(lower)
    return drawing


def _shown_as(device: Device, theta: Floats) -> Floats | float:
    """Return the factor by which the figure multiplies both curves; those of an impedance display are divided by
    s^2."""
    return np.sin(theta / 2) ** 2 if device.kind.inverse else 1.0


def _name(device: Device) -> str:
    return f"Re {device.kind.couples}"


def _axis(device: Device) -> str:
    quantity = "conductance" if device.kind.inverse else "resistance"
    return f"{quantity}, {device.kind.coupling_unit(UNITS[device.units])}"


def _positive(required: Floats) -> Floats:
    """Return the positive numbers for a logarithmic axis; nan in place of the others."""
    return np.where(required > 0, required, np.nan)
