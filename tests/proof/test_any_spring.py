"""The stiffness of the hand is eliminated in closed form: the same margin, and no hand that fails among the proved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from device_pairs import real_of
from random_hands import exact_need

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import ForceSensor
from vctune.model.problem import Demands, Uncertainty
from vctune.model.sampled.hand_loop import loop_in_hand, offered, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.claims.delay_parts import parts_of, row_of
from vctune.proof.claims.every_hand import Asked, boxes_over, fixed_of
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import device_box
from vctune.proof.engine.boxes import SAMPLES_BEFORE

T, FACTOR = 1e-3, 1.05
HELD = Hands(Hand(0.0, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))
FEW, MANY = [0, 1], [pytest.param(number, marks=pytest.mark.slow) for number in range(2, 30)]


def drawn(number: int) -> tuple[Device, Gains, Coupling]:
    """Return a random late device with hardly any damping, gains that hardly use the loop, and a coupling."""
    rng = np.random.default_rng((36, number))
    delay = float(f"{rng.uniform(0, 4) * T:.6g}")
    sensor = ForceSensor(delay=4e-4) if number % 3 == 0 else None
    device = Device(rng.uniform(0.1, 1), 10 ** rng.uniform(-2, 0.5), T, delay, force_sensor=sensor)
    K_v = device.damping * 10 ** rng.uniform(-2, 0.5)
    gains = Gains(K_v, rng.choice((0.0, K_v * rng.uniform(1, 20))))
    return device, gains, Coupling(10 ** rng.uniform(0, 1.5), rng.uniform(0.05, 0.5), 10 ** rng.uniform(-1, 0.5))


@pytest.mark.parametrize("number", [*FEW, *MANY])
def test_no_hand_fails_where_every_spring_is_proved(number):
    """The coupling meets the least ratio by a hundredth, and for the nominal device alone."""
    device, gains, coupling = drawn(number)
    rng = np.random.default_rng((7, number))
    hardest = least_ratios_in_hands(device, HELD, gains, coupling)[0]
    coupling = coupling.times(1.01 * FACTOR / hardest.ratio)
    width = 10 ** rng.uniform(-3, -0.3)
    keys = ("mass", "damping", "delay") if device.delay > 0 else ("mass", "damping")
    box = device_box(device, Uncertainty(half_widths=tuple((key, width) for key in keys), objective="nominal"))
    demands = Demands(device, (1.0, 10.0), FACTOR, 100.0, passive=False, hands=HELD)
    asked = Asked(Design(device, gains, coupling), demands, box)
    assert asked.for_every_spring
    proved = 0
    for part in parts_of(device, asked.ends(), apart=True):
        left, _ = asked.left_by_any_spring(part, fixed_of(asked.design), boxes_over(part), 8_000)
        for _ in range(400):
            theta = 10 ** rng.choice((rng.uniform(-3, 0.4), np.log10(hardest.omega * T + 1e-3) + rng.normal(0, 0.05)))
            share = np.where(rng.random(len(part.names)) < 0.5, rng.integers(0, 2, len(part.names)), rng.random())
            at = dict(zip(part.names, part.low[:, 0] + share * (part.high - part.low)[:, 0], strict=True))
            one = with_delay(device.with_numbers({key: at[row_of(key)] for key in box.uncertain}), at, box)
            mass = one.mass + at["operator.mass"]
            near = mass * (2 * np.sin(theta / 2) / T) ** 2 * np.concatenate((1 + np.linspace(-0.6, 0.6, 301), [0, 9]))
            springs = np.clip(near, 0.0, HELD.high.stiffness)
            hand = Hand(at["operator.mass"], at["operator.damping"], springs)
            inside = np.array([not holds(left, part.names, theta, {**at, "operator.stiffness": K}) for K in springs])
            if not inside.any():
                continue
            loop = loop_in_hand(plant_in_hand(one, hand, delays_of(one), FLOATS), np.full(len(springs), theta), FLOATS)
            required = required_in_hand(loop, gains)
            need = required.lost / required.size / offered(coupling, one, theta, FLOATS)
            place = int(np.argmax(np.where(inside, need, -np.inf)))
            exact = exact_need(real_of(one), gains, coupling, replace(hand, stiffness=float(springs[place])), theta / T)
            assert exact * FACTOR < 1
            assert abs(exact - need[place]) <= 1e-5 * max(abs(exact), 1e-3)
            proved += 1
    assert proved > 5


def with_delay(device: Device, at: dict[str, float], box) -> Device:
    if SAMPLES_BEFORE not in at:
        return device
    delay = np.floor(at[SAMPLES_BEFORE]) * T + at["device.delay"]
    at[SAMPLES_BEFORE] = np.floor(at[SAMPLES_BEFORE])
    delay = float(np.clip(delay, box.low.delay, box.high.delay))
    at["device.delay"] = delay - at[SAMPLES_BEFORE] * T
    return device.with_numbers({"delay": delay})


def holds(boxes, names, theta: float, at: dict[str, float]) -> bool:
    """Return whether one of the boxes holds a place, to within rounding."""
    point = np.array([theta, *(at[name] for name in names)])[:, None]
    blur = 1e-9 * np.abs(point) + 1e-12
    return bool(np.any(np.all((boxes.low <= point + blur) & (point - blur <= boxes.high), axis=0)))
