"""Find the growing motion of a loop in one hand with one environment, in double precision."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand, met_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World

STEPS, OFFSET, SETTLED = 60, 1e-7, 1e-10  # of Newton's iteration, relative to the angle


class Growth(NamedTuple):
    """A motion that grows as e^(rate t)."""

    hz: float
    rate: float  # 1/s


@np.errstate(all="ignore")
def growth_near(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, world: World, omega: float
) -> Growth | None:
    """Return the growing motion whose frequency is next to a given one, rad/s; None if none is found.

    A pole of the loop is a zero of the whole impedance, continued from the unit circle to z = e^(j theta) of complex
    theta; it grows where Im theta < 0.
    """
    plant, T = plant_in_hand(device, hand, delays_of(device), FLOATS), device.sample_time

    def whole(theta: complex) -> complex:
        at, seen = met_in_hand(loop_in_hand(plant, theta, FLOATS), device, gains, coupling, theta, FLOATS)
        s, c = np.sin(theta / 2), np.cos(theta / 2)
        reactive = s * at.reactance - c * (seen.swing / seen.size)
        reactive += s * s * (2 / T) * world.mass - c * c * (T / 2) * world.stiffness
        return complex(at.resistance - seen.lost / seen.size + world.damping + 1j * reactive / (s * c))

    theta = complex(omega * T)
    for _ in range(STEPS):
        step = OFFSET * abs(theta)
        slope = (whole(theta + step) - whole(theta - step)) / (2 * step)
        moved = whole(theta) / slope if slope else complex("nan")
        theta -= moved * min(1.0, 0.2 * abs(theta) / max(abs(moved), 1e-300))
        if not np.isfinite(theta) or not 0 < theta.real < pi:
            return None
        if abs(moved) < SETTLED * abs(theta):
            return Growth(theta.real / (2 * pi * T), -theta.imag / T) if theta.imag < 0 else None
    return None
