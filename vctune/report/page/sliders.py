"""The data of the page's sliders: the parameters that a reader can try, and the constants of the device (README.md,
section 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from math import inf
from typing import Any

from vctune.analysis.in_hands import RatioInAnyHand, RatioInHand
from vctune.document.records.design_json import DesignRecord
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.problem import Problem, Range
from vctune.report.page.constants import frequency_model, in_hands, numbered, sampled_loop
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.panel import Panel

REACH = 10.0  # Factor between the shipped value and each end of a slider
# Names of the curves that the script draws into a figure, in the order of the figure's axes
PANELS_OF = {
    "llewellyn": ("resistance", "ratio"),
    "hands": ("in_hand", "hand_ratio"),
    "any-hand": ("in_hand", "hand_ratio"),
    "impedance": ("impedance",),
    "nyquist": ("nyquist",),
}


def sliders(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    record: DesignRecord,
    worst: Sequence[RatioInHand | RatioInAnyHand],
) -> dict[str, Any]:
    """Return the object that the page's script reads."""
    stability, transparency, operator = problem.stability, problem.transparency, problem.device.operator
    band, hands, numbers = problem.stability.band.hz, _hands(problem, worst), dict[str, int]()
    constants = {
        "model": frequency_model(problem, record),
        "sampled": sampled_loop(problem.device, record),
        "hands": in_hands(problem.device, hands, [each.omega for each in worst]) if hands else None,
    }
    return {
        "display": problem.device.display,
        "rigid": coupling.damping == inf,
        "variables": _variables(problem, gains, coupling),
        "sample_time": problem.device.sample_time,
        "factor": stability.safety_factor,
        "worlds": problem.worlds is not None,
        "max_sensitivity": stability.max_sensitivity,
        "reference": transparency.reference_impedance,
        "weights": list(astuple(transparency.weights)),
        "norm": transparency.norm,
        "band_hz": [band[0], None if band[1] == inf else band[1]] if problem.passive else None,
        "operator_damping": 0.0 if operator is None else operator.damping,
        "transparency_hz": list(transparency.band.hz),
        "hands": ["any passive hand" if hand is None else hand.in_words(problem.units) for hand in hands],
        "constants": numbered(constants, numbers),
        "numbers": list(numbers),
    }


def _hands(problem: Problem, worst: Sequence[RatioInHand | RatioInAnyHand]) -> list[Hand | None]:
    """Return the vertices of the box of hands and its worst hands; [None], which stands for any passive hand, for an
    impedance display that requires it."""
    if problem.any_hand:
        return [None]
    corners = [] if problem.hands_met is None else problem.hands_met.corners
    return list(dict.fromkeys([*corners, *(each.hand for each in worst)]))


def overlays(drawn: dict[str, Drawing]) -> dict[str, list[dict[str, Any]]]:
    """Return the positions, in each figure's points, of the panels into which the script draws tried curves."""
    named = {name: tuple(panel.name for panel in drawn[name].panels) for name in ("transparency",) if name in drawn}
    return {
        name: [_panel(panel, curve) for curve, panel in zip(curves, drawn[name].panels, strict=False)]
        for name, curves in (PANELS_OF | named).items()
        if name in drawn
    }


def _panel(panel: Panel, curve: str) -> dict[str, Any]:
    return {
        "curve": curve,
        "box": [round(each, 2) for each in panel.box],
        "x": [*map(float, panel.get_xlim()), panel.x.logarithmic],
        "y": [*map(float, panel.get_ylim()), panel.y.logarithmic],
    }


def _variables(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[dict[str, Any]]:
    """Return the name, unit, shipped value and ends of each slider. A b_c of infinity has no slider."""
    bounds, device, damping, units = problem.bounds, problem.device, coupling.damping, problem.units
    named: list[tuple[str, str, str, float, Range, float]]
    coupled: list[tuple[str, str, str, float, Range, float]]
    if isinstance(coupling, SpringDamper):
        stiffness, T = coupling.stiffness, device.sample_time
        named = [
            ("gains.velocity", "K_v", units.damping, gains.velocity, bounds.velocity, device.mass / device.loop_lag),
            ("coupling.damping", "b_c", units.damping, damping, bounds.damping, stiffness * T),
            ("coupling.stiffness", "k_c", units.stiffness, stiffness, bounds.stiffness, 1.0),
        ]
    else:
        coupled = [
            ("coupling.damping", "b_c", units.damping, damping, bounds.damping, 1.0),
            ("coupling.mass", "m_c", units.mass, coupling.mass, bounds.mass, 1.0),
            ("coupling.drag", "b_0", units.damping, coupling.drag, bounds.drag, damping),
        ]
        corner = (device.damping + gains.velocity) / device.loop_lag
        named = [
            ("gains.velocity", "K_v", units.damping, gains.velocity, bounds.velocity, 1.0),
            ("gains.position", "K_p", units.stiffness, gains.position, bounds.position, corner),
            *coupled,
        ]
    return [
        {"key": key, "symbol": symbol, "unit": unit, "value": value, "top": REACH * value if value > 0 else most,
         "low": value / REACH if value > 0 else 0.0, "bounds": None if range_.fixed else [range_.min, range_.max]}
        for key, symbol, unit, value, range_, most in named
        if key in device.kind.stated and value < inf
    ]  # fmt: skip
