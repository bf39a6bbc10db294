"""Random whole problems with a given design, one function for each kind of display, hands and environments.

They are drawn so that every number of a record is met; whether they are stable is not asked.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np
from draws import (
    Rng,
    Tables,
    admittance,
    built_servo,
    coupling_for,
    decades,
    decimal,
    delays_are_clear,
    gains_for,
    hands_for,
    impedance,
    sections,
    spring_for,
    stable_in,
    stated,
    widths_of,
)

UNCERTAIN = (
    "mass", "damping", "delay", "velocity.filter_hz", "actuator.bandwidth_hz", "force_sensor.bandwidth_hz",
    "structure.frequency_hz", "servo.delay", "servo.bandwidth_hz",
)  # fmt: skip
FASTEST = 5e-4
"""Least sample time of a device with readings, s: kicks of a faster one take seconds."""


def chance(rng: Rng, share: float) -> bool:
    """Return whether something with a probability happens."""
    return bool(rng.random() < share)


def yardstick(rng: Rng, tables: Tables, impedance: float) -> Tables:
    """Return a table that states how the error is measured, or nothing."""
    if chance(rng, 0.4):
        return {}
    T = tables["sample_time"]
    low = decimal(0.5 / T * 10 ** rng.uniform(-3, -2))
    found: Tables = {"band_hz": [low, decimal(low * 10 ** rng.uniform(0.5, 1.5))]}
    found["reference_impedance"] = decimal(impedance * 10 ** rng.uniform(-1, 1))
    if chance(rng, 0.5):
        found["norm"] = "peak"
    if chance(rng, 0.5):
        found["weights"] = {
            name: decimal(rng.uniform(0.1, 3)) for name in ("admittance", "tracking", "coupling") if chance(rng, 0.7)
        }
    return {"transparency": found}


def with_readings(rng: Rng, device: Tables) -> Tables:
    """Return a device whose encoder or force sensor has steps, and that may have friction."""
    if device["sample_time"] < FASTEST:
        return device
    found = {key: dict(value) if isinstance(value, dict) else value for key, value in device.items()}
    if found.get("velocity", {}).get("from") != "measured" and chance(rng, 0.5):
        dual = found.get("display") == "impedance"
        found["velocity"] = ({} if dual else {"from": "difference"}) | found.get("velocity", {})
        found["velocity"]["resolution"] = decades(rng, -6, -4)
    if found.get("display") != "impedance" and chance(rng, 0.3):
        found["force_sensor"] = found.get("force_sensor", {}) | {"resolution": decades(rng, -4, -2)}
    if chance(rng, 0.3):
        found["friction"] = decades(rng, -4, -0.5)
    return found


def wielded(rng: Rng, problem: Tables) -> Tables:
    """Return a problem with a tool, by chance."""
    if chance(rng, 0.3):
        most = problem["operator"]["mass"]["max"] or 0.1
        heavy = {"min": decimal(0.1 * most), "max": decimal(0.3 * most)}
        problem["tool"] = {"mass": heavy if chance(rng, 0.5) else heavy["min"]}
        if chance(rng, 0.5):
            problem["tool"]["damping"] = decimal(0.1 * (problem["operator"]["damping"]["max"] or 1.0))
    return problem


def turned(rng: Rng, problem: Tables) -> Tables:
    """Return a problem as it is or of a rotary device."""
    if "operator" not in problem or chance(rng, 0.7):
        return problem
    return problem | {"device": problem["device"] | {"units": "rotary"}}


def own_loop(
    rng: Rng, criterion: str, world: str = "", *, uncertain: bool = False, disc: bool = False, scale: float = 4.0
) -> Tables:
    """An admittance display in its hands, on a band, or both."""
    while True:
        device = admittance(rng, flexible=world == "")
        T = device["sample_time"]
        gains, box = gains_for(rng, device), hands_for(rng, device["mass"], T)
        widths = widths_of(rng, device, UNCERTAIN, 2) if uncertain else {}
        if stable_in(device, gains, box) and delays_are_clear(device, widths):
            break
    coupling = coupling_for(rng, device, gains[0], 1.0)
    coupling = tuple(scale * number for number in coupling)
    stability: Tables = {"criterion": criterion, "safety_factor": float(rng.choice([1.0, 1.05, 1.3]))}
    more = yardstick(rng, device, gains[0])
    if criterion != "hands":
        nyquist = 0.5 / T
        stability["band_hz"] = [
            decimal(nyquist * 10 ** rng.uniform(-3, -2)),
            decimal(nyquist * 10 ** rng.uniform(-1, -0.3)),
        ]
    if disc:
        more["uncertainty"] = {"unmodelled": [[decimal(0.01 / T), 0.02], [decimal(0.2 / T), decades(rng, -1.7, -1)]]}
    if widths:
        more["uncertainty"] = widths | ({"objective": "worst"} if chance(rng, 0.3) else {})
    if world:
        more["environment"] = environment(rng, gains[0], T, world)
    if world == "nothing":
        coupling = (inf, *coupling[1:])
    if not world or world == "box":
        device = with_readings(rng, device)
    return turned(rng, wielded(rng, stated(device, gains, coupling, stability, box, more)))


def environment(rng: Rng, scale: float, T: float, which: str) -> Tables:
    """Return a table of environments about as great as an impedance."""
    mass, stiff = decimal(scale * T * 10 ** rng.uniform(-1, 1.5)), decimal(scale / T * 10 ** rng.uniform(-3, -1))
    if which == "nothing":
        return {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}
    found: Tables = {"mass": {"min": decimal(mass * 0.1), "max": mass}, "stiffness": {"max": stiff}}
    found["damping"] = {"min": decimal(scale * 10 ** rng.uniform(-2, 0))}
    if which == "walls":
        found["walls"] = True
        if chance(rng, 0.5):
            found["corner_hz"] = decimal(float(rng.choice([0.03, 0.3, 0.9])) / (np.pi * T))
    return found


def servo(
    rng: Rng, world: str = "", *, uncertain: bool = False, disc: bool = False, rule: str = "", spring: bool = False
) -> Tables:
    """A vendor's servo in its hands."""
    while True:
        some = ("position", "low-pass", "late sensor", "coefficient", "felt sections", "spring", "whole samples")
        parts = [part for part in some if chance(rng, 0.3) and not (rule and part == "spring")]
        parts += ["spring"] if spring else []
        device = built_servo(rng, *parts, order=int(rng.integers(1, 3)), most=5)
        widths = widths_of(rng, device, UNCERTAIN, 2) if uncertain else {}
        if delays_are_clear(device, widths):
            break
    high = np.array([decades(rng, -1, 0.7), decades(rng, 0, 1.5), decades(rng, 1, 3)])
    low = np.array([*map(decimal, high * rng.choice([0.0, 0.2], 3))])
    late = device["servo"]["delay"] + 0.3 / device["servo"]["bandwidth_hz"] + device["sample_time"]
    drag = decimal(4 * high[2] * late + high[0] / late)
    coupling: tuple[float, ...] = (decimal(3 * drag), decimal(drag * late * decades(rng, -0.5, 1)), drag)
    if chance(rng, 0.3):
        coupling = (inf, *coupling[1:])
    more = yardstick(rng, device, drag)
    if world:
        more["environment"] = environment(rng, drag, device["sample_time"], world)
    if widths or disc:
        more["uncertainty"] = widths
        if disc:
            hz = device["servo"]["bandwidth_hz"]
            more["uncertainty"] = widths | {"unmodelled": [[hz, 0.02], [decimal(10 * hz), decades(rng, -1.5, -1)]]}
    if chance(rng, 0.3):
        device["force_sensor"] = device.get("force_sensor", {}) | {"resolution": decades(rng, -3, -1)}
    stability = {"criterion": "hands", "safety_factor": float(rng.choice([1.0, 1.05]))}
    problem = stated(device, None, coupling, stability, (low, high), more)
    if rule:
        problem["coupling"] = {"rule": rule, "mass": decimal(2 * drag * device["sample_time"]), "drag": drag}
    return turned(rng, wielded(rng, problem))


def display(rng: Rng, criterion: str, *, rigid: bool = False, uncertain: bool = False) -> Tables:
    """An impedance display, before any environment or as a wall."""
    while True:
        device = impedance(rng, parts=criterion == "hands")
        if rigid and criterion == "hands" and chance(rng, 0.2):
            device["velocity"] = device.get("velocity", {}) | {"from": "measured"}
        gains = (0.0 if rigid else decimal(device["damping"] * rng.choice([0.0, 0.5])), 0.0)
        box = hands_for(rng, device["mass"], device["sample_time"])
        widths = widths_of(rng, device, UNCERTAIN, 2) if uncertain else {}
        if stable_in(device, gains, box) and delays_are_clear(device, widths):
            break
    coupling = tuple(0.2 * number for number in spring_for(rng, device))
    if "sections" in device.get("velocity", {}) or chance(rng, 0.2):
        device["velocity"] = device.get("velocity", {}) | {"sections": sections(rng)}
    stability: Tables = {"criterion": criterion, "safety_factor": float(rng.choice([1.0, 1.05, 1.3]))}
    more = yardstick(rng, device, device["mass"] / device["sample_time"] * 0.01)
    if rigid:
        more["environment"] = {"stiffness": inf}
    if widths:
        more["uncertainty"] = widths
    problem = stated(with_readings(rng, device), None if rigid else gains, coupling, stability, box, more)
    return turned(rng, wielded(rng, problem))


POSED: dict[str, Callable[[Rng], Tables]] = {
    "both": lambda rng: own_loop(rng, "both"),
    "band": lambda rng: own_loop(rng, "passive"),
    "band, disc": lambda rng: own_loop(rng, "passive", disc=True),
    "band, uncertain": lambda rng: own_loop(rng, "passive", uncertain=True),
    "hands": lambda rng: own_loop(rng, "hands"),
    "hands, weak": lambda rng: own_loop(rng, "hands", scale=0.02),
    "hands, uncertain": lambda rng: own_loop(rng, "hands", uncertain=True),
    "hands, nothing behind": lambda rng: own_loop(rng, "both", "nothing"),
    "hands, environments": lambda rng: own_loop(rng, "hands", "box"),
    "hands, walls": lambda rng: own_loop(rng, "hands", "walls"),
    "servo": servo,
    "servo, nothing behind": lambda rng: servo(rng, "nothing", rule=str(rng.choice(["", "euler"]))),
    "servo, environments": lambda rng: servo(rng, "box"),
    "servo, walls": lambda rng: servo(rng, "walls"),
    "servo, uncertain": lambda rng: servo(rng, uncertain=True),
    "servo, disc": lambda rng: servo(rng, disc=True),
    "servo, spring": lambda rng: servo(rng, spring=True),
    "display": lambda rng: display(rng, "hands"),
    "display, both": lambda rng: display(rng, "both"),
    "display, uncertain": lambda rng: display(rng, "hands", uncertain=True),
    "wall": lambda rng: display(rng, "hands", rigid=True),
    "wall in any hand": lambda rng: display(rng, "both", rigid=True),
    "wall, uncertain": lambda rng: display(rng, "hands", rigid=True, uncertain=True),
}
"""By name; the place of a kind seeds its draws, so that new ones come last."""
