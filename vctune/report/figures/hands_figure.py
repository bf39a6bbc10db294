"""The requirement in the hands of a box up to Nyquist, and each hand's share of the coupling's resistance."""

from __future__ import annotations

from math import pi

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import least_ratios_in_any_hand, least_ratios_in_hands
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
from vctune.report.figures.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    RED,
    WIDTH,
    around_one,
    canvas,
    decades,
    frequency_axis,
    legend_above,
)

CURVES = 40
"""Angles per decade of the curves. Half shows corners; twice makes the file twice as long."""
PLACES, DAMPINGS = 17, (0.0, 0.1, 1.0)
"""Masses and stiffnesses of the map along each side, and the shares of the range of dampings, of which the worst is
shown."""
LOWEST, MAPPED = 1e-3, 24
"""Least angle and angles per decade of the map. Half as many are 2 % off at the steepest place, twice as many 0.1 %."""
LEVELS = (0, 20, 40, 60, 70, 80, 90, 95, 100, 120)
"""Levels of the map, %: closer where it is tight. Half or twice as many read no better."""
POWERS = (-3, 5)
"""Powers of ten from which on, and up to which, an axis of the map is in plain decimals."""
SHALLOW = 1e-9
"""Share of the greatest R that is shown at least; at Nyquist R may vanish. Half and twice it: as many decades."""
WORST = 3
"""Number of hands with a curve of their own: of the lowest minima, not two of one hand."""


def hands_figure(problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling) -> Figure:
    """Draw Re Z_c against the R of the worst hands, and a map of the share that they need over mass and stiffness.

    Parameters
    ----------
    problem : the device
    hands : hands of the claim
    gains, coupling : the design

    Returns
    -------
    Figure
    """
    columns, above = {"linear": (2, 0.8), "rotary": (1, 1.15)}[problem.device.units]  # whose units are longer
    figure = canvas(WIDTH, 6.4 + above, left=0.85, top=above, gaps=(0, 0.5))
    curves, ratio, plane = figure.subplots(3, 1, height_ratios=(5, 4, 4))
    _curves(curves, ratio, problem, hands, gains, coupling)
    legend_above(curves, columns)
    _map(figure, plane, problem, hands, gains, coupling)
    return figure


def _curves(axes: Axes, lower: Axes, problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling) -> None:
    device, units = problem.device, problem.units
    where = loops_in_hands(device, hands, per_decade=CURVES)
    some = where.theta > 0
    hz = where.theta[some] / (2 * pi * device.sample_time)
    required = where.required(gains)[:, some]
    Z_c, greatest = offered(coupling, device, where.theta[some], FLOATS), required.max(axis=0)
    scale, name = _shown_as(device, where.theta[some]), _name(device)
    axes.semilogy(hz, scale * Z_c, color=BLUE, label=f"{name} as it runs")
    axes.semilogy(hz, scale * _positive(greatest), color=ORANGE, label="greatest R, and in hands of:")
    lower.plot(hz, Z_c / _positive(greatest), color=BLUE, label=f"{name} / R in the worst hand")
    found = least_ratios_in_hands(device, hands, gains, coupling)
    around_one(lower, problem.stability.safety_factor, found[0].ratio, hertz(found[0].omega))
    shown: list[Hand] = []
    for worst in found:
        if worst.hand not in shown and len(shown) < WORST:
            shown.append(worst.hand)
            one = loops_in_hands(device, Hands(worst.hand, worst.hand), per_decade=CURVES).required(gains)[0, some]
            axes.semilogy(hz, scale * _positive(one), linewidth=0.9, color=(RED, INK, GREY)[len(shown) - 1],
                          linestyle=("--", ":", "-.")[len(shown) - 1], label=worst.hand.in_words(units))  # fmt: skip
    axes.set_ylabel(_unit(device))
    for each in (axes, lower):
        frequency_axis(each, hz[0], hz[-1])
    axes.set_xlabel("")
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, SHALLOW * high), high)
    decades(axes)
    legend_above(lower, 2)


def _map(figure: Figure, axes: Axes, problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling) -> None:
    """Draw the greatest R/Re Z_c over angle and damping, as a share."""
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
    drawn = axes.contourf(mass, stiffness, 100 * np.clip(need, 0.0, 1.2), levels=LEVELS, cmap="cividis")
    figure.colorbar(drawn, ax=axes, label=f"R of {_name(device)}, %")
    axes.set(xlabel=f"{units.mass_name} of the hand, {units.mass}", ylabel=f"stiffness, {units.stiffness}")
    axes.ticklabel_format(style="sci", scilimits=POWERS)


def any_hand_figure(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Figure:
    """Draw Re 1/Z_c of an impedance display against the R of any passive hand, and their ratio, up to Nyquist.

    Parameters
    ----------
    problem : the device
    gains, coupling : the design

    Returns
    -------
    Figure
    """
    device = problem.device
    where = loops_in_any_hand(device, CURVES)
    some = where.theta > 0
    theta = where.theta[some]
    hz, required = theta / (2 * pi * device.sample_time), where.required(gains)[0, some]
    given, scale = offered(coupling, device, theta, FLOATS), _shown_as(device, theta)
    figure = canvas(WIDTH, 5.6, left=0.85, top=0.75, gaps=(0, 0.5))
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 2))
    upper.loglog(hz, scale * given, color=BLUE, label=f"{_name(device)} as it runs")
    upper.loglog(hz, scale * _positive(required), "--", color=ORANGE, label="R in any passive hand")
    upper.set_ylabel(_unit(device))
    lower.plot(hz, given / _positive(required), color=BLUE, label=f"{_name(device)} / R")
    least = least_ratios_in_any_hand(device, gains, coupling)[0]
    around_one(lower, problem.stability.safety_factor, least.ratio, hertz(least.omega))
    for each in (upper, lower):
        frequency_axis(each, hz[0], hz[-1])
    upper.set_xlabel("")
    decades(upper)
    legend_above(upper, 2)
    legend_above(lower, 2)
    return figure


def _shown_as(device: Device, theta: Floats) -> Floats | float:
    """Return the factor for showing offer and requirement: those of an impedance display are over s^2."""
    return np.sin(theta / 2) ** 2 if device.kind.inverse else 1.0


def _name(device: Device) -> str:
    return f"Re {device.kind.couples}"


def _unit(device: Device) -> str:
    return device.kind.coupling_unit(UNITS[device.units])


def _positive(required: Floats) -> Floats:
    """Return positive numbers, nan elsewhere, for a logarithmic axis."""
    return np.where(required > 0, required, np.nan)
