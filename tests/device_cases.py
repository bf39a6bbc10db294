"""A device with parts, its gains and a coupling, and what the oracles say of it with 150 digits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from arithmetic import Digits
from device_oracle import Real, operator_impedance, response_at
from device_pairs import real_of
from random_devices import far_apart, ordinary, ordinary_gains
from sampled_device_oracle import LET_GO, pulses

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains

NUM = Digits(150)
"""|q| - Re q, as it stands, cancels four times as many digits as a frequency lies decades below a device's corners:
nine decades leave more than 100 of these."""


@dataclass(frozen=True)
class Case:
    """A device in numbers of vctune, with its design; the name says how it is made again."""

    device: Device
    gains: Gains
    coupling: Coupling
    name: str

    @property
    def real(self) -> Real:
        return real_of(self.device)

    def at(self, omega: float, num: Any = NUM) -> Any:
        """Return everything of the frequency model, at rad/s."""
        return response_at(self.real, self.gains, num.i * num.number(omega), num)

    def held_resistance(self, omega: float) -> Any:
        """Return Re G_hh in the hand of the least operator, at rad/s."""
        found, Z_h = self.at(omega), operator_impedance(self.real, NUM.i * NUM.number(omega), NUM)
        return (found.G_hh / (1 + Z_h * found.G_hh)).real

    @property
    def let_go(self) -> Real:
        """The device as its velocity loop meets it: without hand and force sensor."""
        return real_of(replace(self.device, operator=None, force_sensor=None))

    def sensitivity(self, theta: Any, num: Any = NUM) -> Any:
        """Return S of the sampled loop at e^(j theta)."""
        G_x, G_v, _ = pulses(self.let_go, LET_GO, num.exp(num.i * num.number(theta)), num)
        return 1 / (1 + num.number(self.gains.velocity) * G_v + num.number(self.gains.position) * G_x)


def cases(kind: str, seed: int, count: int) -> Iterator[tuple[Case, np.random.Generator]]:
    """Yield random cases, "far apart" or "ordinary", each with a source of further random numbers."""
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        if kind == "far apart":
            device, gains, coupling = far_apart(seed, number)
        else:
            device = ordinary(rng)
            gains, coupling = ordinary_gains(device, rng)
        yield Case(device, gains, coupling, f"{kind} {seed}, {number}"), rng
