"""Devices with parts: every formula the same in every arithmetic; balls and enclosures contain what is true."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, pi
from typing import Any

import numpy as np
import pytest
from agreement import contains
from arithmetic import Digits
from balls import BALLS, ball
from conftest import drawn
from devices import NUM, Case, cases
from flint import ctx

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.loop.device_response import device_response
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import G_hh_abs2, loop_response, tracking_abs2
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.plant_in_hand import Delays, delays_of, plant_in_hand
from vctune.model.sampled.velocity_loop import (
    PlantLetGo,
    ReturnDifference,
    plant_let_go,
    return_difference,
    sensitivity_abs2,
)
from vctune.proof.claims.band import conditions_margin, low_margin
from vctune.proof.claims.cases import Case as ClaimCase
from vctune.proof.claims.poles import along_drive, model_curve
from vctune.proof.claims.sensitivity import across_position
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, between, decimal
from vctune.proof.enclosures.taylor import Taylor, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR

Formula = Callable[[Device, Gains, Coupling, Number, Arithmetic], Number]


def at(device: Device, gains: Gains, omega: Number, ops: Arithmetic) -> Any:
    return loop_response(device_response(device, omega, ops), gains, ops)


def plant_of(device: Device, ops: Arithmetic) -> PlantLetGo:
    """Return the sampled plant; the delay's whole samples are those of about its middle."""
    whole, fraction = split_delay(plain(device.delay), plain(device.sample_time))
    return plant_let_go(device, whole, ops, fractional=fraction > 0)


def sampled(device: Device, theta: Number, ops: Arithmetic, gains: Gains) -> ReturnDifference:
    return return_difference(plant_of(device, ops), theta, ops, position=not ops.is_zero(gains.position))


def plain(x: Number) -> float:
    """Return about the middle of a number of any arithmetic."""
    if isinstance(x, Taylor):
        return float(x.coefficients[0, 0])
    return float(x.mid if isinstance(x, Enclosure) else x)


FACTOR = 1.25
"""A binary fraction, so that it is the same number in every arithmetic."""


def claimed(device: Device, gains: Gains, coupling: Coupling, ops: Arithmetic) -> ClaimCase:
    design = Design(device, gains, coupling)
    return ClaimCase(
        Demands(device, (0.0, inf), FACTOR, inf), design, FACTOR, inf, None, 1, Delays(0, False, 0, False), {},
        lambda: plant_of(device, ops), lambda: plant_in_hand(device, Hand(0, 0, 0), delays_of(device), ops), ops,
    )  # fmt: skip


FORMULAS: dict[str, Formula] = {
    "R": lambda d, g, c, w, ops: required_resistance(at(d, g, w, ops), ops),
    "G_hh": lambda d, g, c, w, ops: G_hh_abs2(at(d, g, w, ops)),
    "tracking": lambda d, g, c, w, ops: tracking_abs2(at(d, g, w, ops)),
    "resistance": lambda d, g, c, w, ops: at(d, g, w, ops).resistance,
    "conditions": lambda d, g, c, w, ops: conditions_margin(claimed(d, g, c, ops), w),
    "next to 0": lambda d, g, c, w, ops: low_margin(claimed(d, g, c, ops), w),
    "poles": lambda d, g, c, w, ops: model_curve(claimed(d, g, c, ops), w).im,
    "any position": lambda d, g, c, w, ops: along_drive(claimed(d, g, c, ops), w),
}
SAMPLED: dict[str, Formula] = {
    "sensitivity": lambda d, g, c, w, ops: sensitivity_abs2(sampled(d, w, ops, g), g),
    "turns": lambda d, g, c, w, ops: sampled(d, w, ops, g).closed(g).re,
    "across": lambda d, g, c, w, ops: across_position(claimed(d, g, c, ops), w)[0],
}


def value(name: str, case: Case, x: float) -> float:
    """Return a formula in doubles, at omega or theta."""
    formula = (FORMULAS | SAMPLED)[name]
    return float(formula(case.device, case.gains, case.coupling, np.array(x), FLOATS))


ORACLES = ("R", "G_hh", "tracking", "sensitivity")
"""What there is a value of that shares nothing with vctune's formula."""
QUICK = Digits(80)
"""For matrix exponentials, in which nothing cancels."""


def true_value(name: str, case: Case, x: Any) -> Any:
    """Return what the oracles say of a formula, at omega or theta."""
    if name == "sensitivity":
        return abs(case.sensitivity(x, QUICK)) ** 2
    found = case.at(x)
    return {"R": found.required, "G_hh": abs(found.G_hh) ** 2, "tracking": abs(found.tracking) ** 2}[name]


def places(case: Case, rng: np.random.Generator) -> dict[str, float]:
    """Return for each formula where it is looked at: omega, or theta."""
    omega = float(pi / case.device.sample_time * 10 ** rng.uniform(-3, 0))
    theta = float(pi * 10 ** rng.uniform(-3, 0))
    return dict.fromkeys(FORMULAS, omega) | dict.fromkeys(SAMPLED, theta)


def numbers_of(case: Case) -> dict[str, float]:
    """Return the numbers of a case that may be a variable: gains, coupling, and all of the device but its clock."""
    gains, coupling = case.gains, case.coupling
    found = {"K_v": gains.velocity, "K_p": gains.position}
    found |= {"b_c": coupling.damping, "m_c": coupling.mass, "b_0": coupling.drag}
    return found | {key: x for key, x in case.device.numbers().items() if key != "sample_time"}


def case_of(case: Case, numbers: dict[str, Any], number: Callable[[Any], Any]) -> tuple[Device, Gains, Coupling]:
    """Return device, gains and coupling of other numbers; `number` makes one of what is none of these."""
    K_v, K_p, b_c, m_c, b_0 = (numbers[name] for name in ("K_v", "K_p", "b_c", "m_c", "b_0"))
    own = {key: x for key, x in numbers.items() if key in case.device.numbers()}
    return case.device.converted(number).with_numbers(own), Gains(K_v, K_p), Coupling(b_c, m_c, b_0)


def wider(x: float, width: float, rng: np.random.Generator) -> Enclosure:
    low, high = rng.uniform(0.1, 1.0, 2) * width
    return between(np.array(x * (1 - low)), np.array(x * (1 + high)))


@pytest.mark.slow
@np.errstate(all="ignore")
@pytest.mark.parametrize("kind", ["far apart", "ordinary"])
def test_enclosures_contain_what_the_oracles_say(kind):
    formulas = FORMULAS | SAMPLED
    finite = 0
    for case, rng in cases(kind, 34, drawn(40)):
        for name, x in places(case, rng).items():
            if name not in ORACLES:
                continue
            true = true_value(name, case, x)
            for width in (1e-14, 1e-9, 1e-6, 1e-3):
                boxes = {key: wider(n, width, rng) if n else Enclosure(0.0) for key, n in numbers_of(case).items()}
                place = wider(x, width, rng)
                found = formulas[name](*case_of(case, boxes, decimal), place, ENCLOSURES)
                assert contains(found, true), (case, name, width)
                at, *rows = variables([place, *boxes.values()], [True, *(bool(np.any(n.rad)) for n in boxes.values())])
                polynomials = dict(zip(boxes, rows, strict=True))
                over = formulas[name](*case_of(case, polynomials, decimal), at, TAYLOR).enclosed()
                assert contains(over.subset(0), true), (case, name, width)
                finite += bool(np.isfinite(found.rad))
    assert finite > 300 * drawn(40) / 40


@np.errstate(all="ignore")
@pytest.mark.parametrize("count", [8, pytest.param(drawn(60), marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["far apart", "ordinary"])
def test_every_formula_is_the_same_in_every_arithmetic(kind, count):
    """Balls of 600 bits stand for the truth: in them, in balls of 128, in enclosures, and near them in doubles."""
    formulas, finite = FORMULAS | SAMPLED, 0
    for case, rng in cases(kind, 37, count):
        for name, x in places(case, rng).items():
            formula, numbers = formulas[name], numbers_of(case)
            with ctx.workprec(600):
                true = formula(*case_of(case, {key: ball(n) for key, n in numbers.items()}, ball), ball(x), BALLS)
                with ctx.workprec(128):
                    balls = formula(*case_of(case, {key: ball(n) for key, n in numbers.items()}, ball), ball(x), BALLS)
                assert balls.overlaps(true), (case, name)
                boxes = {key: decimal(np.array(n)) for key, n in numbers.items()}
                found = formula(*case_of(case, boxes, decimal), decimal(np.array(x)), ENCLOSURES)
                exact = NUM.number(true.mid().str(60, radius=False))
                assert contains(found, exact), (case, name)
                away = abs(NUM.number(value(name, case, x)) - exact)
                finite += bool(np.isfinite(found.rad))
                assert not np.isfinite(found.rad) or away <= 4 * float(found.rad), (case, name)
    assert finite >= 0.8 * count * len(formulas), finite
