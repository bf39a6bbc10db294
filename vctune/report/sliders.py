"""What the page's sliders need: the complex constants of a device per frequency, in which everything is affine.

The script on the page closes the loop with them for any gains (README.md, section 1); it knows no device.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import astuple
from itertools import product
from math import inf, pi
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.analysis.resonance import with_resonance
from vctune.analysis.sampled_loop import return_difference_at
from vctune.document.record import DesignRecord
from vctune.model.affine import Affine, loop_constants
from vctune.model.arithmetic import FLOATS
from vctune.model.device_response import device_response
from vctune.model.hand_loop import delays_of, loop_in_hand, plant_in_hand
from vctune.model.pair import EvenOdd, Pair
from vctune.model.problem import Problem, Range
from vctune.model.quantities import Coupling, Device, Gains, Hand, Hands
from vctune.model.transparency import log_quadrature
from vctune.report.curves import frequencies

PANELS = 8
"""Parts of the transparency band with Gauss's nodes in each: the sampled error is the design's to 1e-6 and better. Half
misses a resonance in the band, twice is a longer page."""
SHOWN = 100
"""Frequencies of the curves beside the nodes. Half shows corners, twice is a longer page."""
ANGLES, PER_SAMPLE = 120, 16
"""Angles of the sampled loop up to Nyquist, and how many more of them even for each sample of delay, so that its curve
turns by less than half a turn from one to the next. Half shows corners in Nyquist's picture."""
IN_HAND, LOWEST = 128, 1e-3
"""Angles in each hand, and the least beside 0. Half steps over the narrow minima of stiff hands, twice is a longer
page."""
REACH = 10.0
"""By what factor a slider goes up and down from the shipped value."""
PANELS_OF = {
    "llewellyn": ("resistance", "ratio"),
    "hands": ("in_hand", "hand_ratio"),
    "impedance": ("impedance",),
    "transparency": ("admittance", "tracking", "coupling", "error"),
    "nyquist": ("nyquist",),
}
"""Which axes of a figure the script draws tried curves in, in the order of the figure's axes."""


def sliders(problem: Problem, gains: Gains, coupling: Coupling, record: DesignRecord) -> dict[str, Any]:
    """Return the object that the page's script works on.

    Parameters
    ----------
    problem : of the nominal device
    gains, coupling : the shipped design
    record : of it; where its extrema are belongs to the samples
    """
    stability, transparency, operator = problem.stability, problem.transparency, problem.device.operator
    band, worst, hands = problem.stability.band.hz, [], []
    if problem.hands_met is not None:
        worst = least_ratios_in_hands(problem.device, problem.hands_met, gains, coupling)
        hands = list(dict.fromkeys([*_corners(problem.hands_met), *(each.hand for each in worst)]))
    return {
        "variables": _variables(problem, gains, coupling),
        "sample_time": problem.device.sample_time,
        "factor": stability.safety_factor,
        "max_sensitivity": stability.max_sensitivity,
        "reference": transparency.reference_impedance,
        "weights": list(astuple(transparency.weights)),
        "norm": transparency.norm,
        "band_hz": [band[0], None if band[1] == inf else band[1]] if problem.passive else None,
        "operator_damping": 0.0 if operator is None else operator.damping,
        "transparency_hz": list(transparency.band.hz),
        "hands": [hand.in_words(problem.units) for hand in hands],
        "constants": {
            "model": _frequency_model(problem, record),
            "sampled": _sampled_loop(problem.device, record),
            "hands": _in_hands(problem.device, hands, [each.omega for each in worst]) if hands else None,
        },
    }


def overlays(drawn: dict[str, Figure]) -> dict[str, list[dict[str, Any]]]:
    """Return where on each figure, in its own points, the axes are in which tried curves are drawn.

    Parameters
    ----------
    drawn : figures that have been written, so that their axes have their places
    """
    return {
        name: [_axes(drawn[name], number, curve) for number, curve in enumerate(curves)]
        for name, curves in PANELS_OF.items()
        if name in drawn
    }


def _axes(figure: Figure, number: int, curve: str) -> dict[str, Any]:
    axes = figure.axes[number]
    width, height = (72 * inches for inches in figure.get_size_inches())
    place = axes.get_position()
    box = place.x0 * width, height * (1 - place.y1), place.width * width, place.height * height
    return {
        "curve": curve,
        "box": [round(each, 2) for each in box],
        "x": [*map(float, axes.get_xlim()), axes.get_xscale() == "log"],
        "y": [*map(float, axes.get_ylim()), axes.get_yscale() == "log"],
    }


def _variables(problem: Problem, gains: Gains, coupling: Coupling) -> list[dict[str, Any]]:
    """Return the five sliders: what each is called, its unit, shipped value and ends; those that are 0 begin there."""
    bounds, scale, units = problem.bounds, problem.device.damping + gains.velocity, problem.units
    named: tuple[tuple[str, str, str, float, Range, float], ...] = (
        ("gains.velocity", "K_v", units.damping, gains.velocity, bounds.velocity, 1.0),
        ("gains.position", "K_p", units.stiffness, gains.position, bounds.position, scale / problem.device.loop_lag),
        ("coupling.damping", "b_c", units.damping, coupling.damping, bounds.damping, 1.0),
        ("coupling.mass", "m_c", units.mass, coupling.mass, bounds.mass, 1.0),
        ("coupling.drag", "b_0", units.damping, coupling.drag, bounds.drag, coupling.damping),
    )
    return [
        {"key": key, "symbol": symbol, "unit": unit, "value": value, "top": REACH * value if value > 0 else most,
         "low": value / REACH if value > 0 else 0.0, "bounds": None if range_.fixed else [range_.min, range_.max]}
        for key, symbol, unit, value, range_, most in named
    ]  # fmt: skip


def _frequency_model(problem: Problem, record: DesignRecord) -> dict[str, Any]:
    """Return the constants of the frequency model, and the weights of the error's quadrature."""
    wanted, axis = problem.transparency.band, frequencies(problem)
    nodes, weights = log_quadrature(wanted.min, wanted.max, PANELS)
    places = [2 * pi * axis[:: max(1, axis.size // SHOWN)], [wanted.min, wanted.max]]
    proof, edges = record.certificate, problem.stability.band
    places.append([edge for edge in (edges.min, edges.max) if 0 < edge < inf])
    if proof is not None and proof.worst_hz and proof.worst_hz > 0:
        places.append([2 * pi * proof.worst_hz])
    omega = np.unique(np.concatenate([nodes, *places]))
    share = np.zeros(omega.size)
    share[np.searchsorted(omega, nodes)] = weights
    at = device_response(problem.device.modelled, omega, FLOATS)
    known = loop_constants(at)
    turned = None if at.sensor is None else -omega * at.sensor.lag
    return {
        "hz": _numbers(omega / (2 * pi)),
        "weight": _numbers(share),
        "controller": _affine(known.controller, omega),
        "C": _affine(known.C, omega) if turned is not None else None,
        "sensor_im": None if turned is None else _numbers(turned),
        "D": _affine(known.D, omega),
        "miss": _affine(known.miss, omega),
        "numerator": None if problem.device.structure is None else _affine(known.numerator, omega),
    }


def _sampled_loop(device: Device, record: DesignRecord) -> dict[str, Any]:
    """Return the parts of the sampled loop's return difference."""
    theta, loop = np.geomspace(1e-5 * pi, pi, ANGLES), record.inner_loop
    even = int(PER_SAMPLE * (4 + device.delay / device.sample_time))
    theta = np.union1d(theta, np.linspace(0.0, pi, even + 1)[1:])
    if loop is not None and loop.peak_sensitivity_hz:
        theta = np.union1d(theta, min(2 * pi * loop.peak_sensitivity_hz * device.sample_time, pi))
    if device.structure is not None:
        theta = np.union1d(
            theta, np.minimum(with_resonance(device, theta / device.sample_time) * device.sample_time, pi)
        )
    parts = return_difference_at(device.bare.modelled, theta / device.sample_time, position=True)
    return {
        "theta": _numbers(theta),
        **{name: _pair(getattr(parts, name), theta) for name in ("open", "velocity", "position")},
    }


def _corners(hands: Hands) -> list[Hand]:
    ends = zip(astuple(hands.low), astuple(hands.high), strict=True)
    return [Hand(*numbers) for numbers in product(*(sorted(set(pair)) for pair in ends))]


def _in_hands(device: Device, met: list[Hand], worst: list[float]) -> dict[str, Any]:
    """Return the parts of the loop in some hands, at angles up to Nyquist and at the worst frequencies, rad/s."""
    theta = np.geomspace(LOWEST, pi, IN_HAND)
    theta = np.unique(np.concatenate([[0.0], theta, [each * device.sample_time for each in worst]]))
    some = Hand(*(np.array(numbers)[:, None] for numbers in zip(*map(astuple, met), strict=True)))
    loop = loop_in_hand(plant_in_hand(device, some, delays_of(device), FLOATS), theta, FLOATS)
    shape = (len(met), theta.size)
    return {
        "theta": _numbers(theta),
        **{name: _even_odd(part, shape) for name, part in loop._asdict().items()},
    }


def _affine(number: Affine, omega: Floats) -> dict[str, str | None]:
    parts = {"constant": number.constant, "velocity": number.velocity, "position": number.position}
    return {name: None if part is None else _pair(part, omega) for name, part in parts.items()}


def _pair(number: Pair, like: Floats) -> str:
    """Return a complex number at each place as its real and imaginary parts in turn."""
    return _numbers(np.stack([number.re + 0 * like, number.im + 0 * like], axis=-1))


def _even_odd(number: EvenOdd, shape: tuple[int, int]) -> list[str]:
    """Return even and odd parts in turn, at each angle, for each hand."""
    parts = np.stack([np.broadcast_to(part, shape) for part in (number.even, number.odd)], axis=-1)
    return [_numbers(each) for each in parts]


def _numbers(values: Floats) -> str:
    """Return doubles to the last bit, in base 64: shorter than as decimals."""
    return b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()
