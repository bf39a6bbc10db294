"""A device with parts, its gains and a coupling, and what the oracles say of it with 150 digits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from arithmetic import Digits
from device_pairs import Tables, tables_of
from frequency import Demanded, demanded
from loop import Loop, sensitivity
from random_devices import far_apart, ordinary, ordinary_gains

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import LoopResponse, loop_response
from vctune.model.numbers.arithmetic import FLOATS

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

    @cached_property
    def tables(self) -> Tables:
        """The tables that the oracles read."""
        return tables_of(self.device)

    def at(self, omega: float, num: Any = NUM) -> Demanded:
        """Return everything of the frequency model, at rad/s."""
        return demanded(self.tables, astuple(self.gains), num.i * num.number(omega), num)

    @property
    def let_go(self) -> Tables:
        """The device as its velocity loop meets it: without hand and force sensor."""
        return tables_of(replace(self.device, operator=None, force_sensor=None))["device"]

    def sensitivity(self, theta: Any, num: Any = NUM) -> Any:
        """Return S of the sampled loop at e^(j theta)."""
        return sensitivity(Loop(self.let_go, astuple(self.gains), num=num), num.exp(num.i * num.number(theta)))


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


def loop_of(device: Device, gains: Gains, omega: Any) -> LoopResponse:
    """Return vctune's velocity loop at frequencies in rad/s, in doubles."""
    return loop_response(device_response(device, np.asarray(omega), FLOATS), gains, FLOATS)
