"""A controller as controller.json states it, evaluated by Python's own arithmetic: nothing of vctune is used."""

from __future__ import annotations

from math import inf
from types import SimpleNamespace

import numpy as np


class Stated:
    """The difference equations of controller.json, run from the first to the last."""

    def __init__(
        self, record, *, mass=0.0, damping=0.0, stiffness=0.0, zero=0.0, wall=False, rule="backward", limit=inf
    ):
        constants = {name: each["value"] for name, each in record["coefficients"].items()}
        T, gain, lossless = constants["sample_time"], constants.get("position_gain", 0.0), rule == "trapezoid"
        self.constants = constants | {
            "inertance": (2 * mass if lossless else mass) / T,
            "inertia_carry": float(lossless),
            "stiffness": stiffness,
            "zero": zero,
            "slope": damping + (T / 2 if lossless else T) * stiffness,
            "least_contact": 0.0 if wall else -inf,
            "limit": limit,
            "position_reach": limit / gain if gain > 0 else inf,
        }
        self.state = dict.fromkeys(record["state"], 0.0)
        self.equations = [(each["name"], compile(each["is"], each["name"], "eval")) for each in record["equations"]]
        self.output = record["output"]

    def step(self, position, velocity, force):
        """Return the command; every value of the sample is in `values`."""
        read = {"measured_position": position, "measured_velocity": velocity, "measured_force": force}
        before = SimpleNamespace(**self.state)
        self.values = self.constants | read | {"before": before, "minimum": min, "maximum": max, "choice": choice}
        for name, code in self.equations:
            self.values[name] = eval(code, {"__builtins__": {}}, self.values)
        self.state = {name: self.values[name] for name in self.state}
        return self.values[self.output]


def choice(above, limit, yes, no):
    return yes if above > limit else no


def closed_loop(device, stated):
    """Return the matrix of a sampled device, `firmware.Device`, under a controller that is linear."""
    names, count = list(stated.state), device.size

    def step(memory):
        stated.state = dict(zip(names, memory[count:], strict=True))
        body = memory[:count]
        command = stated.step(float(device.position(body)), float(body[1]), float(device.force(body)))
        return np.concatenate([device.wait(body, command), list(stated.state.values())])

    return np.array([step(unit) for unit in np.eye(count + len(names))]).T
