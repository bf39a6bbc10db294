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

SCHEMA = "vctune/controller/1"  # Name and version of the format of controller.json
# Formulas of the coefficients that the user sets at run time
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


def controller_record(firmware: Firmware) -> dict[str, Any]:
    """Return the object of controller.json."""
    units = firmware.units
    coefficients = {
        name: {**_described(COEFFICIENTS[name], units), "value": number}
        for name, number in firmware.coefficients.items()
    }
    settings = {
        name: {**_described(COEFFICIENTS[name], units), "formula": units.translated(FORMULAS[name])}
        for name in (*BUILT_IN, *limiting(firmware))
    }
    blocks = ("estimate", "drive", "environment", "law")
    assert all(isfinite(number) for number in firmware.coefficients.values())
    return {
        **({} if certified(firmware) else {"not_proved": not_proved(firmware)}),
        "schema": SCHEMA,
        "name": firmware.name,
        "problem_sha256": firmware.problem_sha256,
        "design_sha256": firmware.design_sha256,
        "status": firmware.record.status,
        "proved": firmware.record.promise,
        "assumed": assumptions(firmware),
        "precision": firmware.precision,
        **({"gains": asdict(firmware.gains)} if firmware.device.kind.own_loop else {}),
        "coupling": asdict(firmware.coupling),
        "inputs": {quantity.name: _described(quantity, units) for quantity in inputs_of(firmware)},
        "coefficients": coefficients,
        "settings": settings,
        "state": {name: _described(STATE[name], units) for name in (*state_names(firmware), "inertia")},
        "equations": [
            {
                "block": block,
                "name": equation.quantity.name,
                **_described(equation.quantity, units),
                "is": plain(equation.right),
            }
            for block in blocks
            for equation in getattr(equations, block)(firmware.parts)
        ],
        "output": "command",
        "versions": {"vctune": __version__},
    }


def _described(quantity: Quantity, units: Units) -> dict[str, str]:
    return {"symbol": quantity.symbol, "unit": quantity.unit(units), "meaning": units.translated(quantity.meaning)}
