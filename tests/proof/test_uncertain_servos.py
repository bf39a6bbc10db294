"""Proofs of boxes of servos, with and without a disc, against a dense scan in doubles that shares nothing with them."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import inf, pi
from statistics import median

import numpy as np
import pytest
from conftest import drawn
from flint import ctx
from random_servos import Case, random_case, servo_device
from scipy.optimize import minimize
from servo_oracle import Grip, coupling, seen, vertices
from test_servo_proof import HANDS, NO_GAINS, NUMBERS, coupling_of, demands_of, follower

from vctune.model.device import Device, ForceSensor, Servo
from vctune.model.gains import Coupling
from vctune.model.problem import Uncertainty
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import DeviceBox, device_box
from vctune.proof.enclosures.arb_balls import PRECISION
from vctune.proof.engine.interval import Outcome, Verdict

MANY = drawn(40)
WIDEST = 0.3
RADII = ((5.0, 0.05), (50.0, 0.3))
SECONDS = 5.0
"""Of a proof at the median."""


@dataclass(frozen=True)
class Uncertain:
    """A servo in hands, with relative half-widths of its numbers, and whether there is a disc."""

    case: Case
    widths: dict[str, float]
    disc: bool
    seed: int

    @property
    def box(self) -> DeviceBox:
        radii = RADII if self.disc else ()
        device = self.case.device
        device = replace(device, servo=replace(device.servo, radii=radii))
        return device_box(device, Uncertainty(tuple(self.widths.items()), "nominal"))


def uncertain_servo(number: int) -> Uncertain:
    random = np.random.default_rng((91, number))
    case = random_case(random)
    keys = [key for key in NUMBERS if case.device.number(key)]
    some = random.permutation(keys)[: 1 + number % 4].tolist()
    widths = {key: round(float(random.uniform(0.02, WIDEST)), 3) for key in some}
    return Uncertain(case, widths, bool(number % 2), number)


def asked(one: Uncertain, device: Device, theta: np.ndarray) -> np.ndarray:
    """Return the drag that the worst vertex of the hands asks for, with the rest of the coupling."""
    units = np.array([seen(follower(device), Grip(*unit), theta) for unit in np.eye(3)])
    Z = np.array([[*vars(hand).values()] for hand in vertices(one.case.low, one.case.high)]) @ units
    hertz, r = theta / (2 * pi * device.sample_time), 0.0
    if one.disc:
        (first, _), _ = RADII
        r = np.exp(np.interp(np.log(hertz), *np.log(np.array(RADII)).T)) * np.minimum(hertz / first, 1.0)
    virtual = replace(one.case.virtual, drag=0.0)
    return (r * np.abs(Z) - Z.real - coupling(virtual, device.sample_time, theta).real).max(axis=0)


@cache
def least_drag(number: int) -> float:
    """Return the greatest drag that a device of the box asks for: a dense scan, and from its peaks uphill."""
    one = uncertain_servo(number)
    box, random = one.box, np.random.default_rng((92, number))
    ends = {key: (box.low.number(key), box.high.number(key)) for key in one.widths}

    def device(shares: np.ndarray) -> Device:
        pairs = zip(ends.items(), shares, strict=True)
        return box.nominal.with_numbers({key: float(a + x * (b - a)) for (key, (a, b)), x in pairs})

    samples = (one.case.servo.delay + one.case.servo.sensor_delay) / one.case.servo.sample_time
    theta = np.unique(np.concatenate((np.geomspace(1e-3, pi, 400), np.linspace(0.01, pi, 220 + int(26 * samples)))))
    corners = [*map(np.array, product((0.0, 1.0), repeat=len(ends)))]
    found = []
    for shares in [*corners, *random.uniform(size=(60, len(ends)))]:
        over = asked(one, device(shares), theta)
        found.append((float(over.max()), float(theta[over.argmax()]), shares))
    found.sort(key=lambda each: -each[0])

    def less(place: np.ndarray) -> float:
        at = np.array([np.clip(np.exp(place[0]), 1e-4, pi)])
        return -float(asked(one, device(np.clip(place[1:], 0.0, 1.0)), at)[0])

    uphill = [minimize(less, [np.log(at), *shares], method="Nelder-Mead").fun for _, at, shares in found[:4]]
    high = one.case.high
    rest = [high.stiffness * follower(device(shares)).latency - one.case.low.damping for shares in corners]
    blur = high.stiffness * RADII[0][1] / (2 * pi * RADII[0][0]) if one.disc else 0.0  # r |K/(j omega)|
    return max(found[0][0], *(-each for each in uphill), *(each + blur for each in rest))


def judged(number: int, share: float) -> tuple[Outcome, float]:
    one = uncertain_servo(number)
    virtual = replace(one.case.virtual, drag=share * least_drag(number))
    box, begin = one.box, time.process_time()
    with ctx.workprec(PRECISION):
        design = Design(box.nominal, NO_GAINS, coupling_of(virtual))
        found = prove_hands(design, demands_of(box.nominal, one.case.hands), box)
    return found, time.process_time() - begin


def check(number: int, share: float) -> float:
    """Assert the verdict, and of what is refuted that its device asks for more; return the processor time, s."""
    one, (found, seconds) = uncertain_servo(number), judged(number, share)
    assert found.verdict is (Verdict.PROVED if share > 1 else Verdict.REFUTED)
    if share < 1:
        box, device = one.box, found.device or one.box.nominal
        assert all(box.low.number(key) <= device.number(key) <= box.high.number(key) for key in one.widths)
        theta = np.array([max(found.witness * device.sample_time, 1e-6)])  # of 0 the oracle knows nothing
        assert asked(one, device, theta)[0] > share * least_drag(number) * (1 - 1e-6)
    return seconds


@pytest.mark.parametrize("number", [2, 5])
@pytest.mark.parametrize("share", [1.01, 0.99])
def test_a_box_is_judged(number, share):
    check(number, share)


@pytest.mark.slow
def test_every_box_is_judged(capsys):
    seconds = [check(number, share) for number in range(MANY) for share in (1.01, 0.99)]
    with capsys.disabled():
        sys.stdout.write(
            f"\n{MANY} boxes of servos 1 % beside the least drag: processor time median {median(seconds):.2f} s, "
            f"greatest {max(seconds):.1f} s\n"
        )
    assert median(seconds) < SECONDS


def test_a_box_of_four_numbers_and_a_disc_is_proved_in_seconds():
    """Delay, bandwidth and both numbers of the sensor by 0.3: once without an answer after 60 s."""
    device = servo_device(2e-3, Servo(0.012, 20.0, 2, radii=RADII), ForceSensor(60.0, 1, 2.5e-3))
    box = device_box(device, Uncertainty(tuple((key, WIDEST) for key in NUMBERS), "nominal"))
    with ctx.workprec(PRECISION):
        design = Design(device, NO_GAINS, Coupling(inf, 2.0, 400.0))
        found = prove_hands(design, demands_of(device, HANDS), box)
    assert found.verdict is Verdict.PROVED
    assert found.boxes < 20_000
