"""Write all difference equations with their coefficients, for other languages: the object of controller.json."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

from vctune.firmware.c_source import BUILT_IN, inputs_of, limiting, state_names
from vctune.firmware.c_text import plain
from vctune.firmware.firmware import Firmware, certified
from vctune.firmware.preamble import assumptions, not_proved
from vctune.model.numbers.units import Units
from vctune.simulation.firmware import equations
from vctune.simulation.firmware.equations import COEFFICIENTS, STATE, Quantity
from vctune.version import __version__

SCHEMA = "vctune/controller/1"
FORMULAS = {
    "inertance": "mass / sample_time; by the trapezoidal rule 2 * mass / sample_time",
    "inertia_carry": "0; by the trapezoidal rule 1",
    "stiffness": "stiffness",
    "zero": "zero",
    "slope": "damping + sample_time * stiffness; by the trapezoidal rule damping + half_sample_time * stiffness",
    "least_contact": "0 at a wall, else minus infinity",
    "limit": "the greatest force, infinity for none",
    "position_reach": "limit / position_gain, infinity for none",
}
"""Formulas of the coefficients that the user sets at run time. Such coefficients are not constants of the design."""


def controller_record(made: Firmware) -> dict[str, Any]:
    """Return the object of controller.json.

    Parameters
    ----------
    made : the design as firmware

    Returns
    -------
    dict
        Each quantity with symbol, unit and meaning. A program must evaluate the equations from first to last.
        `before.NAME` is the
            value of NAME after the previous sample; `choice(a, b, c, d)` is c if a > b, else d.
    """
    units = made.units
    coefficients = {
        name: {**_told(COEFFICIENTS[name], units), "value": number} for name, number in made.coefficients.items()
    }
    settings = {
        name: {**_told(COEFFICIENTS[name], units), "formula": units.translated(FORMULAS[name])}
        for name in (*BUILT_IN, *limiting(made))
    }
    blocks = ("estimate", "drive", "environment", "law")
    assert all(isfinite(number) for number in made.coefficients.values())
    return {
        **({} if certified(made) else {"not_proved": not_proved(made)}),
        "schema": SCHEMA,
        "name": made.name,
        "problem_sha256": made.problem_sha256,
        "design_sha256": made.design_sha256,
        "status": made.record.status,
        "proved": made.record.promise,
        "assumed": assumptions(made),
        "precision": made.precision,
        **({"gains": asdict(made.gains)} if made.device.kind.own_loop else {}),
        "coupling": asdict(made.coupling),
        "inputs": {one.name: _told(one, units) for one in inputs_of(made)},
        "coefficients": coefficients,
        "settings": settings,
        "state": {name: _told(STATE[name], units) for name in (*state_names(made), "inertia")},
        "equations": [
            {"block": block, "name": one.quantity.name, **_told(one.quantity, units), "is": plain(one.right)}
            for block in blocks
            for one in getattr(equations, block)(made.parts)
        ],
        "output": "command",
        "versions": {"vctune": __version__},
    }


def _told(quantity: Quantity, units: Units) -> dict[str, str]:
    return {"symbol": quantity.symbol, "unit": quantity.unit(units), "meaning": units.translated(quantity.meaning)}
