"""Random devices, gains, hands and couplings as the tables of a problem file, and what is asked of any of them.

Nothing of vctune is imported.
"""

from __future__ import annotations

from itertools import compress, product
from math import pi
from typing import Any

import frequency
import numpy as np
from frequency import STRUCTURES
from loop import NOTHING, Loop, radius
from scipy import signal

Tables = dict[str, Any]
Rng = np.random.Generator
Floats = np.ndarray
NUMBERS = ("mass", "damping", "stiffness")
LEAST = 1e-3
"""Least angle of a scan, rad."""


def decimal(x: float) -> float:
    """Return a number with six digits, as a file has it."""
    return float(f"{x:.6g}")


def decades(rng: Rng, low: float, high: float) -> float:
    """Return a random number between two powers of 10."""
    return decimal(10 ** rng.uniform(low, high))


def short(x: float) -> float:
    """Return a number with three digits, of which a few are as many samples of delay exactly."""
    return float(f"{x:.3g}")


def late(rng: Rng, most: float) -> float:
    """Return samples of delay that are not next to a whole number: there a proof covers other delays as well."""
    return float(rng.integers(0, int(most) + 1) + rng.choice([0.0, 0.0, rng.uniform(0.1, 0.9)]))


def sections(rng: Rng) -> list[list[float]]:
    """Return a notch, a low-pass of order 1 to 4, a moving average, y += a (x - y), or any pair of poles and zeros."""
    corner, kind = 10 ** rng.uniform(-1.5, -0.4), int(rng.integers(5))
    if kind == 0:
        found = signal.tf2sos(*signal.iirnotch(2 * corner, 10 ** rng.uniform(0, 0.7)))
    elif kind == 1:
        found = signal.butter(int(rng.integers(1, 5)), 2 * corner, output="sos")
    elif kind == 2:
        count = int(rng.integers(2, 6))
        found = signal.tf2sos(np.full(count, 1 / count), np.eye(count)[0])
    elif kind == 3:
        a = rng.uniform(0.1, 1)
        found = np.array([[a, 0, 0, 1, a - 1, 0]])
    else:
        poles, zeros = (r * np.exp(2j * np.pi * corner * f) for r, f in rng.uniform(0.3, 0.95, (2, 2)))
        b, a = (np.poly([x, np.conj(x)]).real for x in (zeros, poles))
        found = np.array([[*(b * sum(a) / sum(b)), *a]])
    return [[float(x) for x in row] for row in found]


def springs(rng: Rng, mass: float, T: float, most: int = 3) -> Tables:
    """Return two or three springs, the last one by its stiffness."""
    shares = rng.dirichlet(np.ones(int(rng.integers(3, most + 2))) * 2)[1:]
    found = {}
    for table, share in zip(STRUCTURES, shares, strict=False):
        one = {"handle_mass": decimal(mass * max(share, 0.02)), "frequency_hz": decimal(decades(rng, -1.5, -0.6) / T)}
        found[table] = one | {"damping_ratio": decades(rng, -2, -0.7)}
    last = found[table]
    last["stiffness"] = decimal(last["handle_mass"] * (2 * pi * last.pop("frequency_hz")) ** 2)
    return found


def built(rng: Rng, *parts: str) -> Tables:  # noqa: PLR0912
    """Return an admittance display with these parts alone."""
    T, mass = short(decades(rng, -3.7, -2.7)), decades(rng, -1.3, 1)
    device: Tables = {"mass": mass, "sample_time": T, "damping": decimal(mass / T * 10 ** rng.uniform(-4, -1.5))}
    sensor: Tables = {}
    for part in parts:
        if part == "delay":
            device["delay"] = decimal(int(rng.integers(1, 4)) * T)
        elif part == "part of a sample":
            device["delay"] = decimal(float(rng.uniform(0.1, 0.9) + rng.integers(0, 2)) * T)
        elif part == "difference":
            device["velocity"] = device.get("velocity", {}) | {"from": "difference"}
        elif part == "filter":
            device["velocity"] = device.get("velocity", {}) | {
                "filter_hz": decimal(decades(rng, -1.5, -0.5) / T),
                "filter_order": int(rng.integers(1, 3)),
            }
        elif part == "measured":
            device["velocity"] = device.get("velocity", {}) | {"from": "measured"}
        elif part == "at handle":
            device["velocity"] = device.get("velocity", {}) | {"at": "handle"}
        elif part == "sections":
            device["velocity"] = device.get("velocity", {}) | {"sections": sections(rng)}
        elif part == "felt sections":
            sensor["sections"] = sections(rng)
        elif part == "actuator":
            device["actuator"] = {"bandwidth_hz": decimal(decades(rng, -1.2, 0) / T), "order": int(rng.integers(1, 3))}
        elif part == "structure":
            device["structure"] = {"handle_mass": decimal(mass * rng.uniform(0.05, 0.6))}
            device["structure"] |= {
                "frequency_hz": decimal(decades(rng, -1.5, -0.5) / T),
                "damping_ratio": decades(rng, -2, -0.7),
            }
        elif part in ("springs", "two springs"):
            device |= springs(rng, mass, T, 3 if part == "springs" else 2)
        elif part == "low-pass":
            sensor |= {"bandwidth_hz": decimal(decades(rng, -1.3, 0) / T), "order": int(rng.integers(1, 3))}
        elif part == "late sensor":
            sensor["delay"] = decimal(T * max(late(rng, 2), 0.3))
        elif part == "coefficient":
            sensor["filter_coefficient"] = decimal(rng.uniform(0.1, 0.9))
    return device | ({"force_sensor": sensor} if sensor else {})


CHOICES = ("difference", "filter", "actuator", "low-pass", "late sensor", "structure")
COMBINATIONS = [
    (*late, *compress(CHOICES, there))
    for late in ((), ("delay",), ("part of a sample",))
    for there in product((False, True), repeat=len(CHOICES))
]
"""Parts that a device may have together."""


def combined(rng: Rng, number: int) -> Tables:
    """Return an admittance display with the number-th combination of parts, one after the other."""
    return built(rng, *COMBINATIONS[number % len(COMBINATIONS)])


PARTS = {
    "delay": 0.2, "part of a sample": 0.5, "difference": 0.2, "filter": 0.3, "actuator": 0.3, "low-pass": 0.4,
    "late sensor": 0.3, "structure": 0.3,
}  # fmt: skip
"""Of an admittance display, each with its chance."""


def admittance(rng: Rng, *, flexible: bool = True) -> Tables:
    """Return a device with about half of the parts, whose delays are not of whole samples."""
    while True:
        parts = [part for part, chance in PARTS.items() if rng.random() < chance * (flexible or part != "structure")]
        if sums_are_clear(device := built(rng, *parts), whole=False):
            return device


def parts_of_any_size(rng: Rng, ideal: Tables, rates: tuple[float, float], share: float) -> Tables:
    """Return the tables of parts, each there with a chance; rates are decades relative to the sampling rate."""
    T, found = ideal["sample_time"], dict[str, Any]()

    def has() -> bool:
        return bool(rng.random() < share)

    def low_pass() -> Tables:
        return {"bandwidth_hz": decimal(decades(rng, *rates) / T), "order": int(rng.integers(1, 3))}

    if has():
        found["velocity"] = {"from": str(rng.choice(["measured", "difference"]))}
        if has():
            found["velocity"]["filter_hz"] = decimal(min(decades(rng, *rates), 0.49) / T)
            found["velocity"]["filter_order"] = int(rng.integers(1, 3))
    if has():
        found["actuator"] = low_pass()
    if has():
        found["force_sensor"] = {"delay": decimal(T * decades(rng, -4, 1.5))} if has() else {}
        found["force_sensor"] |= low_pass() if has() else {}
    if has():
        found["structure"] = {"handle_mass": decimal(ideal["mass"] * min(decades(rng, -3, 0), 0.95))}
        found["structure"]["frequency_hz"] = decimal(decades(rng, *rates) / T)
        found["structure"]["damping_ratio"] = decades(rng, -4, 0.5) * (rng.random() < 0.9)
    return found


def of_any_size(rng: Rng, rates: tuple[float, float] = (-5.5, 2.5), share: float = 0.6) -> Tables:
    """Return an admittance display over ten decades with any of its parts."""
    T, mass = decades(rng, -5, -2), decades(rng, -5, 5)
    ideal: Tables = {"mass": mass, "sample_time": T}
    ideal["delay"] = decimal(T * rng.uniform(0, 3)) * (rng.random() < 0.4)
    ideal["damping"] = decimal(mass / (T / 2 + ideal["delay"]) * 10 ** rng.uniform(-8, 0)) * (rng.random() < 0.9)
    return ideal | parts_of_any_size(rng, ideal, rates, share)


def built_servo(rng: Rng, *parts: str, order: int = 1, most: int = 8) -> Tables:
    """Return a servo with these parts alone."""
    T = short(decades(rng, -3, -2.2))
    whole = "whole samples" in parts
    late_by = float(rng.integers(0, most) + (0.0 if whole else rng.uniform(0.1, 0.9)))
    table: Tables = {"delay": decimal(T * late_by), "bandwidth_hz": decades(rng, 0.5, 1.7), "order": order}
    table["command"] = "position" if "position" in parts else "velocity"
    sensor: Tables = {}
    if "coefficient" in parts:
        sensor["filter_coefficient"] = decimal(rng.uniform(0.15, 0.9))
    if "felt sections" in parts:
        sensor["sections"] = sections(rng)
    if "late sensor" in parts:
        sensor["delay"] = decimal(T * rng.uniform(0.2, 3))
    if "low-pass" in parts:
        sensor |= {"bandwidth_hz": decades(rng, 1, 2.5), "order": int(rng.integers(1, 3))}
    if "spring" in parts:
        table["stiffness"] = decades(rng, 0.5, 2.5)
    return {"sample_time": T, "servo": table} | ({"force_sensor": sensor} if sensor else {})


def servo(rng: Rng) -> Tables:
    """Return a vendor's servo with about half of the parts, whose delays are not of whole samples."""
    while True:
        parts = [part for part in ("position", "low-pass", "late sensor") if rng.random() < 0.4]
        device = built_servo(rng, *parts, order=int(rng.integers(1, 3)), most=20)
        if sums_are_clear(device, whole=False):
            return device


def impedance(rng: Rng, *, parts: bool = True) -> Tables:
    """Return an impedance display."""
    T, mass = decades(rng, -4, -2.7), decades(rng, -1.5, 0.5)
    device: Tables = {"display": "impedance", "mass": mass, "sample_time": T}
    device |= {"damping": decimal(mass / T * 10 ** rng.uniform(-3.5, -1.5)), "delay": decimal(T * late(rng, 2))}
    if rng.random() < 0.5:
        device["velocity"] = {"filter_hz": decades(rng, -1.5, -0.5) / T, "filter_order": int(rng.integers(1, 3))}
    if parts and rng.random() < 0.3:
        device["actuator"] = {"bandwidth_hz": decades(rng, -1.2, 0) / T}
    if parts and rng.random() < 0.3:
        device["structure"] = {"handle_mass": decimal(mass * rng.uniform(0.05, 0.6))}
        device["structure"] |= {"frequency_hz": decades(rng, -1.5, -0.5) / T, "damping_ratio": decades(rng, -2, -0.7)}
    return device


def samples_of(device: Tables) -> float:
    """Return the delay of command and sensor together, in samples."""
    own = device.get("servo", device).get("delay", 0.0) + device.get("force_sensor", {}).get("delay", 0.0)
    return float(round(own / device["sample_time"], 5))


def sums_are_clear(device: Tables, *, whole: bool = True) -> bool:
    """Return whether a delay is not next to one of whole samples, or is one."""
    part = samples_of(device) % 1
    return 0.06 < part < 0.94 or (part == 0 and (whole or samples_of(device) == 0))


def lag_of(device: Tables) -> float:
    """Return about how late a command acts, s."""
    return 1.5 * device["sample_time"] + device.get("delay", 0.0)


def gains_for(rng: Rng, device: Tables, share: float = 0.5) -> tuple[float, float]:
    """Return gains of a size that may be stable, with an integrator by chance."""
    velocity = decimal(device["mass"] / lag_of(device) * 10 ** rng.uniform(-1.5, -0.3))
    return velocity, decimal(velocity / lag_of(device) * 10 ** rng.uniform(-3, -1)) if rng.random() < share else 0.0


def hand_for(rng: Rng, device: Tables) -> tuple[float, float, float]:
    """Return a hand from one that is hardly there to one that moves a device as it likes; often without a part."""
    mass, T = device["mass"], device["sample_time"]
    numbers = mass * decades(rng, -2, 1), mass / T * decades(rng, -3, 0.5), mass / T**2 * decades(rng, -5, 1)
    there = rng.random(3) < 0.75
    there[int(rng.integers(3))] = True
    return triple(decimal(x * has) for x, has in zip(numbers, there, strict=True))


def operator_for(rng: Rng, device: Tables) -> Tables:
    """Return the table of a least operator, often without mass or without damping."""
    mass, T = device["mass"], device["sample_time"]
    found = {"mass": decimal(mass * decades(rng, -3, 1)), "damping": decimal(mass / T * decades(rng, -6, 0))}
    return {key: number for key, number in found.items() if rng.random() < 0.7}


def coupling_for(rng: Rng, device: Tables, impedance: float, share: float = 0.5) -> tuple[float, float, float]:
    """Return b_c, m_c and b_0, the last with a chance."""
    b_c = decimal(impedance * 10 ** rng.uniform(-1, 1))
    drag = decimal(b_c * 10 ** rng.uniform(-3, -0.5)) if rng.random() < share else 0.0
    return b_c, decimal(b_c * lag_of(device) * 10 ** rng.uniform(0, 2)), drag


def spring_for(rng: Rng, device: Tables) -> tuple[float, float]:
    """Return b_c and k_c whose limit is about what the device's damping allows."""
    T, b = device["sample_time"], device["damping"]
    k = decimal(2 * b / T / (1 + device["delay"] / T) ** 2)
    return decimal(k * T * decades(rng, -2, 0)) if rng.random() < 0.6 else 0.0, k


def hands_for(rng: Rng, mass: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a box as human hands or of the device's own size; its least numbers are 0 half of the time."""
    high = np.array([0.5, 30.0, 3000.0]) * 10 ** rng.uniform(-1, 0.3, 3)
    if rng.random() < 0.5:
        high = np.array([mass, mass / T, mass / T**2]) * 10 ** rng.uniform([-2, -3, -5], [0.3, -0.7, -0.7])
    low = high * rng.uniform(0, 0.9, 3) * (rng.random(3) < 0.5)
    return np.array([*map(decimal, low)]), np.array([*map(decimal, high)])


def number_of(device: Tables, key: str) -> float:
    """Return a device's number at a dotted key."""
    table, _, name = key.rpartition(".")
    return float((device[table] if table else device)[name])


def with_numbers(device: Tables, keys: list[str], numbers: Any) -> Tables:
    """Return a device with other numbers at dotted keys."""
    found = {key: dict(value) if isinstance(value, dict) else value for key, value in device.items()}
    for key, number in zip(keys, numbers, strict=True):
        table, _, name = key.rpartition(".")
        (found[table] if table else found)[name] = float(number)
    return found


def ends_of(device: Tables, widths: Tables) -> tuple[Floats, Floats]:
    """Return the least and the greatest of a device's uncertain numbers."""
    middle = np.array([number_of(device, key) for key in widths])
    return middle * (1 - np.array([*widths.values()])), middle * (1 + np.array([*widths.values()]))


def widths_of(rng: Rng, device: Tables, keys: tuple[str, ...], many: int) -> Tables:
    """Return half-widths of so many of the numbers that a device has."""
    tables = [(key, *key.rpartition(".")[::2]) for key in keys]
    there = [key for key, table, name in tables if (device.get(table, {}) if table else device).get(name)]
    return {str(key): decimal(rng.uniform(0.02, 0.2)) for key in rng.permutation(there)[:many]}


def delays_are_clear(device: Tables, widths: Tables) -> bool:
    """Return whether no end of a range of delays is next to a whole number of samples."""
    T, own = device["sample_time"], device.get("servo", device).get("delay", 0.0)
    name = "servo.delay" if "servo" in device else "delay"
    sensor, ends = device.get("force_sensor", {}).get("delay", 0.0), (-1, 1)
    sums = [
        own * (1 + a * widths.get(name, 0)) + sensor * (1 + b * widths.get("force_sensor.delay", 0))
        for a in ends
        for b in ends
    ]
    if name not in widths and "force_sensor.delay" not in widths:
        return True
    return all(0.06 < each / T % 1 < 0.94 for each in sums)


def stable_in(device: Tables, gains: tuple[float, float], box: tuple[np.ndarray, np.ndarray]) -> bool:
    """Return whether the loop before an environment at rest is stable without a hand, in corners and in the middle."""
    low, high = box
    shares = [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), (0, 0, 1), (1, 0, 0), (1, 0, 1)]
    some = [NOTHING, *(triple(low + (high - low) * np.array(share)) for share in shares)]
    return all(radius(Loop(device, gains, hand=hand), at_rest=True) < 1 - 1e-9 for hand in some)


def stated(
    device: Tables,
    gains: tuple[float, float] | None,
    coupling: tuple[float, ...],
    stability: Tables,
    box: tuple[np.ndarray, np.ndarray] | None = None,
    more: Tables | None = None,
) -> Tables:
    """Return a problem's tables."""
    names = ("damping", "stiffness") if device.get("display") == "impedance" else ("damping", "mass", "drag")
    found: Tables = {"device": device, "coupling": dict(zip(names, map(float, coupling), strict=True)), **(more or {})}
    if gains is not None:
        laws = ("velocity",) if device.get("display") == "impedance" else ("velocity", "position")
        found["gains"] = dict(zip(laws, gains, strict=False))
    if box is not None:
        ends = zip(NUMBERS, *box, strict=True)
        found["operator"] = {name: {"min": float(low), "max": float(high)} for name, low, high in ends}
    found["stability"] = stability
    return found


def scaled(coupling: tuple[float, ...], by: float) -> tuple[float, ...]:
    """Return a coupling whose impedance is so many times as great."""
    return tuple(number * by for number in coupling)


def triple(numbers: Any) -> tuple[float, float, float]:
    """Return mass, damping and stiffness as plain numbers."""
    mass, damping, stiffness = (float(x) for x in numbers)
    return mass, damping, stiffness


def angles(device: Tables, count: int = 160) -> np.ndarray:
    """Return angles omega T from `LEAST` to pi, logarithmic and even, more of them for a long delay."""
    own = device.get("servo", device).get("delay", 0.0) + device.get("force_sensor", {}).get("delay", 0.0)
    even = count + int(16 * own / device["sample_time"])
    found = [np.geomspace(LEAST, pi, count), np.linspace(0.01, pi, even)]
    for resonance in frequency.resonances(device)[0] * device["sample_time"] if "structure" in device else ():
        found += [resonance * (1 + np.geomspace(1e-3, 0.5, 20)), resonance * (1 - np.geomspace(1e-3, 0.5, 20))]
    together = np.unique(np.concatenate(found))
    return together[together <= pi]


DIMENSIONS = {
    "mass": (1, 0),
    "handle_mass": (1, 0),
    "damping": (1, -1),
    "drag": (1, -1),
    "velocity": (1, -1),
    "position": (1, -2),
    "stiffness": (1, -2),
    "sample_time": (0, 1),
    "delay": (0, 1),
    "bandwidth_hz": (0, -1),
    "filter_hz": (0, -1),
    "frequency_hz": (0, -1),
    "band_hz": (0, -1),
}
"""Powers of a unit of mass and of a unit of time."""


def in_units(tables: Any, mass: float, time: float, key: str = "") -> Any:
    """Return a problem whose numbers are stated in other units."""
    if isinstance(tables, dict):
        if key == "uncertainty":
            return {
                name: [[hz / time, r] for hz, r in value] if name == "unmodelled" else value
                for name, value in tables.items()
            }
        return {
            name: in_units(value, mass, time, key if name in ("min", "max") else name) for name, value in tables.items()
        }
    if isinstance(tables, list):
        return [in_units(each, mass, time, key) for each in tables]
    a, b = DIMENSIONS.get(key, (0, 0))
    return tables * mass**a * time**b if isinstance(tables, float) else tables
