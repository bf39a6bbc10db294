"""Devices of vctune from the tables of a problem file, and random cases with what the oracles say of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import draws
import numpy as np
from arithmetic import Digits
from draws import Tables, decades, decimal
from frequency import Demanded, demanded
from loop import Loop, sensitivity

import vctune
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains

NUM = Digits(150)
"""|q| - Re q, as it stands, cancels four times as many digits as a frequency lies decades below a device's corners:
nine decades leave more than 100 of these."""


def device_of(table: Tables, operator: Tables | None = None) -> Device:
    """Return the device of a problem file, with its least operator."""
    in_hands = table.get("velocity", {}).get("at") == "handle"  # which is proved in no other hands
    stated: Tables = {"device": table, "stability": {"criterion": "hands"}} if in_hands else {"device": table}
    if operator:
        stated |= {"operator": operator, "stability": {"criterion": "passive"}}
    return vctune.problem(stated).problem.device


@dataclass(frozen=True)
class Case:
    """A device with its least operator, its gains and its coupling; the name says how it is made again."""

    tables: Tables
    law: tuple[float, float]
    offers: tuple[float, float, float]
    name: str

    @cached_property
    def device(self) -> Device:
        """The device as vctune has it."""
        return device_of(self.tables["device"], self.tables["operator"])

    @property
    def gains(self) -> Gains:
        return Gains(*self.law)

    @property
    def coupling(self) -> Coupling:
        return Coupling(*self.offers)

    def at(self, omega: float, num: Any = NUM) -> Demanded:
        """Return everything of the frequency model, at rad/s."""
        return demanded(self.tables, self.law, num.i * num.number(omega), num)

    @property
    def let_go(self) -> Tables:
        """The device as its velocity loop meets it: without hand and force sensor."""
        return {key: table for key, table in self.tables["device"].items() if key != "force_sensor"}

    def sensitivity(self, theta: Any, num: Any = NUM) -> Any:
        """Return S of the sampled loop at e^(j theta)."""
        return sensitivity(Loop(self.let_go, self.law, num=num), num.exp(num.i * num.number(theta)))


def cases(kind: str, seed: int, count: int) -> Iterator[tuple[Case, np.random.Generator]]:
    """Yield random cases, "far apart" or "ordinary", each with a source of further random numbers."""
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        far = kind == "far apart"
        device = (draws.of_any_size if far else draws.admittance)(rng)
        device["hold"] = str(rng.choice(["zoh", "zoh", "lag"]))
        operator = draws.operator_for(rng, device) if rng.random() < 0.35 else {}
        yield (
            Case({"device": device, "operator": operator}, *design_for(rng, device, far), f"{kind} {seed}, {number}"),
            rng,
        )


def design_for(rng: draws.Rng, device: Tables, far: bool) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """Return gains and a coupling, of a size that may be stable or over many decades."""
    if not far:
        gains = draws.gains_for(rng, device)
        return gains, draws.coupling_for(rng, device, gains[0])
    late = draws.lag_of(device)
    impedance = device["mass"] / late + device["damping"]
    position = impedance / late * decades(rng, -8, 0.5) * (rng.random() < 0.7)
    damping = impedance * decades(rng, -4, 3)
    drag = impedance * decades(rng, -8, 0) * (rng.random() < 0.6)
    gains = decimal(impedance * decades(rng, -6, 0.5)), decimal(position)
    return gains, draws.triple(map(decimal, (damping, damping * late * decades(rng, -3, 3), drag)))
