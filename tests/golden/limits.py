"""Fixed designs next to their limit: for each kind of claim a problem with one number open.

The limit is found by bisection over verdicts. The next version must pass and fail on the same sides of it.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import vctune
from vctune.document.reading import parse_problem

WHEEL = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
GAINS = "[gains]\nvelocity = 120.0\nposition = 3000.0\n"
DRAG = "[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = {x!r}\n"
HANDS = '[stability]\ncriterion = "hands"\nsafety_factor = 1.0\n'
PASSIVE = '[stability]\ncriterion = "passive"\nband_hz = [1.0, 60.0]\nsafety_factor = 1.0\n'
SERVO = "[device]\nsample_time = 2e-3\nservo = {{ delay = 0.012, bandwidth_hz = 25.0, order = 2{more} }}\n"
ARM = "[coupling]\ndamping = inf\nmass = 4.0\ndrag = {x!r}\n[stability]\nsafety_factor = {factor}\n"
NOTHING = "[environment]\nmass.max = 0.0\nstiffness.max = 0.0\n"
DESKTOP = '[device]\nmass = 0.1\ndamping = 1.0\nsample_time = 5e-4\ndisplay = "impedance"\n'


class Limit(NamedTuple):
    """A problem with one open number, and whether a greater number passes."""

    text: str
    greater: bool = True
    span: tuple[float, float] = (1e-3, 1e5)


def _servo(more: str = "", rest: str = "", factor: float = 1.0) -> Limit:
    return Limit(SERVO.format(more=more) + rest + ARM.replace("{factor}", str(factor)))


LIMITS = {
    "any passive hand on a band": Limit(WHEEL + GAINS + DRAG + PASSIVE),
    "the safety factor": Limit(WHEEL + GAINS + DRAG + PASSIVE.replace("= 1.0\n", "= 1.3\n")),
    "a held handle": Limit(WHEEL + "[operator]\nmass = 0.05\ndamping = 0.4\n" + GAINS + DRAG + PASSIVE),
    "a band from 0": Limit(WHEEL + GAINS + DRAG + PASSIVE.replace("[1.0,", "[0.0,")),
    "every hand": Limit(WHEEL + GAINS + DRAG + HANDS),
    "one hand": Limit(WHEEL + "[operator]\nmass = 0.3\ndamping = 0.0\nstiffness = 2000.0\n" + GAINS + DRAG + HANDS),
    "without an integrator": Limit(WHEEL + GAINS.replace("3000.0", "0.0") + DRAG + HANDS),
    "a delay of a sample": Limit(WHEEL + "delay = 1e-3\n" + GAINS + DRAG + HANDS),
    "a delay of parts of a sample": Limit(WHEEL + "delay = 4e-4\n" + GAINS + DRAG + HANDS),
    "a sensor": Limit(WHEEL + "[device.force_sensor]\nbandwidth_hz = 150.0\ndelay = 4e-4\n" + GAINS + DRAG + HANDS),
    "an actuator": Limit(WHEEL + "[device.actuator]\nbandwidth_hz = 200.0\n" + GAINS + DRAG + HANDS),
    "a difference": Limit(
        WHEEL + '[device.velocity]\nfrom = "difference"\nfilter_hz = 200.0\n' + GAINS + DRAG + HANDS
    ),
    "a handle that swings": Limit(
        WHEEL + "[device.structure]\nhandle_mass = 0.1\nfrequency_hz = 90.0\ndamping_ratio = 0.02\n"
        + GAINS.replace("120.0", "60.0") + DRAG + HANDS
    ),
    "a box of devices": Limit(
        WHEEL + "[uncertainty]\nmass = 0.1\ndamping = 0.3\n" + GAINS + DRAG + PASSIVE
    ),
    "a box of devices in hands": Limit(WHEEL + "[uncertainty]\nmass = 0.1\n" + GAINS + DRAG + HANDS),
    "a disc of devices": Limit(
        WHEEL + "[uncertainty]\nunmodelled = [[1.0, 0.01], [100.0, 0.1]]\n" + GAINS + DRAG + PASSIVE
    ),
    "a box of environments": Limit(
        WHEEL + "[environment]\nmass = { min = 0.05, max = 5.0 }\nstiffness = { max = 2000.0 }\n" + GAINS + DRAG + HANDS
    ),
    "walls": Limit(
        WHEEL + "[environment]\nmass = { min = 0.05, max = 5.0 }\nstiffness = { max = 2000.0 }\nwalls = true\n"
        + GAINS + DRAG + HANDS
    ),
    "|S|": Limit(
        WHEEL + "[gains]\nvelocity = {x!r}\nposition = 3000.0\n[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = 50.0\n"
        + PASSIVE + "max_sensitivity = 1.5\n", greater=False, span=(50.0, 1e3),
    ),
    "an unstable loop": Limit(
        WHEEL + "[gains]\nvelocity = {x!r}\nposition = 0.0\n[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = 9e3\n"
        + PASSIVE + "max_sensitivity = 1e6\n", greater=False, span=(50.0, 1e4),
    ),
    "an arm in every environment": _servo(rest="[operator]\nmass = { min = 0.0, max = 2.0 }\n", factor=1.05),
    "an arm with nothing behind": _servo(rest=NOTHING),
    "an arm in undamped hands": _servo(
        rest="[operator]\nmass = { min = 0.5, max = 9.0 }\ndamping = 0.0\nstiffness = { min = 0.0, max = 300.0 }\n"
    ),
    "an arm of its own commands": _servo(', command = "position"'),
    "an arm with a disc": _servo(rest="[uncertainty]\nunmodelled = [[0.5, 0.02], [10.0, 0.2]]\n"),
    "an arm next to a whole sample of delay": Limit(
        "[device]\nsample_time = 2e-3\nservo = { delay = 3.92e-3, bandwidth_hz = 60.0, order = 1 }\n"
        "[operator]\nmass = { min = 0.0, max = 2.0 }\nstiffness = { min = 0.0, max = 1000.0 }\n"
        + ARM.replace("{factor}", "1.0")
    ),
    "an arm in one late contact": Limit(
        "[device]\nsample_time = 2e-3\nservo = { delay = 0.012, bandwidth_hz = 25.0, order = 2 }\n"
        "[operator]\nmass = { min = 1.0, max = 6.0 }\ndamping = 0.0\nstiffness = 20.0\n"
        + ARM.replace("{factor}", "1.0")
    ),
    "an arm of uncertain delay": _servo(rest='[uncertainty]\n"servo.delay" = 0.1\n'),
    "any hand on an impedance display": Limit(
        DESKTOP + "[coupling]\ndamping = 0.1\nstiffness = {x!r}\n[stability]\nsafety_factor = 1.0\n", greater=False
    ),
    "hands on an impedance display": Limit(
        DESKTOP + "delay = 5e-4\n[coupling]\ndamping = 0.1\nstiffness = {x!r}\n" + HANDS, greater=False
    ),
    "nobody on an impedance display": Limit(
        DESKTOP + "[operator]\nmass = 0\ndamping = 0\nstiffness = 0\n[coupling]\ndamping = 0.1\nstiffness = {x!r}\n"
        + HANDS, greater=False,
    ),
    "the stiffest spring of environments": Limit(
        WHEEL + "[environment]\nmass = {{ min = 0.05, max = 5.0 }}\nstiffness = {{ max = {x!r} }}\n" + GAINS
        + DRAG.replace("{x!r}", "0.1") + HANDS, greater=False, span=(1e3, 1e6),
    ),
}  # fmt: skip
STEPS = 24
"""Halvings of the logarithm of the open number."""
BESIDE = 2e-3
"""Relative distance from the limit at which the verdict must stay."""


def passes(name: str, number: float) -> bool:
    """Return whether the design with a number in the open place is certified."""
    text = LIMITS[name].text.replace("{x!r}", repr(number)).replace("{{", "{").replace("}}", "}")
    problem = parse_problem(text, name, "limit")
    return vctune.judge(problem, *problem.fixed_design).status.value == "certified"


def limit(name: str) -> float:
    """Return the number next to which the verdict changes."""
    low, high = LIMITS[name].span
    assert passes(name, high) is LIMITS[name].greater and passes(name, low) is not LIMITS[name].greater, name
    for _ in range(STEPS):
        middle = sqrt(low * high)
        low, high = (low, middle) if passes(name, middle) is LIMITS[name].greater else (middle, high)
    return float(f"{high:.7g}")
