"""Random devices with random parts, over ten decades and of an ordinary size; a seed makes each again."""

from __future__ import annotations

from itertools import product
from math import pi
from typing import Any

import numpy as np
from draws import admittance, decades, decimal

from vctune.bench import stress
from vctune.document.reading import problem_at
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS


def parts(rng: np.random.Generator, ideal: dict[str, Any], rates: tuple[float, float], share: float) -> dict[str, Any]:
    """Return the tables of a device's parts, and the operator's.

    Parameters
    ----------
    rng : source of all that is random
    ideal : the device's table
    rates : decades between which bandwidths and resonances lie, relative to the sampling rate
    share : the chance of each part
    """
    T, mass = ideal["sample_time"], ideal["mass"]

    def has() -> bool:
        return bool(rng.random() < share)

    def rate() -> float:
        return decades(rng, *rates) / T

    found: dict[str, Any] = {}
    if has():
        found["velocity"] = {"from": str(rng.choice(["measured", "difference"]))}
        if has():
            found["velocity"] |= {"filter_hz": min(rate(), 0.49 / T), "filter_order": int(rng.integers(1, 3))}
    if has():
        found["actuator"] = {"bandwidth_hz": rate(), "order": int(rng.integers(1, 3))}
    if has():
        found["force_sensor"] = {"delay": decimal(T * decades(rng, -4, 1.5))} if has() else {}
        if has():
            found["force_sensor"] |= {"bandwidth_hz": rate(), "order": int(rng.integers(1, 3))}
    if has():
        handle, ratio = decimal(mass * min(decades(rng, -3, 0), 0.95)), decades(rng, -4, 0.5) * (rng.random() < 0.9)
        found["structure"] = {"handle_mass": handle, "frequency_hz": rate(), "damping_ratio": ratio}
    return found


def operator(rng: np.random.Generator, ideal: dict[str, Any], share: float) -> dict[str, float]:
    """Return the table of a least operator; often without mass or without damping."""
    if rng.random() >= share:
        return {}
    mass, T = ideal["mass"], ideal["sample_time"]
    found = {"mass": mass * decades(rng, -3, 1), "damping": mass / T * decades(rng, -6, 0)}
    return {key: decimal(value) for key, value in found.items() if rng.random() < 0.7}


def far_apart(seed: int, number: int) -> tuple[Device, Gains, Coupling]:
    """Return the number-th device of a seed over the decades of `vctune bench`, with gains and a coupling."""
    rng = np.random.default_rng((seed, number, 2))
    ideal = dict(stress.device(seed, number)[0]["device"])
    document = {"device": ideal | parts(rng, ideal, (-5.5, 2.5), 0.6)}
    if hand := operator(rng, ideal, 0.4):
        document["operator"] = hand
    problem, faults = problem_at(document, "far apart")
    assert problem is not None, faults
    device = problem.device
    tau = float(lags(device, FLOATS).drive)
    impedance = device.mass / tau + device.damping
    position = impedance / tau * decades(rng, -8, 0.5) * (rng.random() < 0.7)
    gains = Gains(decimal(impedance * decades(rng, -6, 0.5)), decimal(position))
    damping = impedance * decades(rng, -4, 3)
    drag = impedance * decades(rng, -8, 0) * (rng.random() < 0.6)
    return device, gains, Coupling(*(decimal(x) for x in (damping, damping * tau * decades(rng, -3, 3), drag)))


def frequencies(device: Device, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return frequencies between nine decades below Nyquist and Nyquist, rad/s; one of them next to a resonance."""
    omega = pi / device.sample_time * 10 ** rng.uniform(-9, 0, count)
    if device.structure is not None:
        omega[-1] = min(2 * pi * device.structure.frequency_hz * rng.uniform(0.9, 1.1), pi / device.sample_time)
    return omega


def ordinary(rng: np.random.Generator, *, held: float = 0.3) -> Device:
    """Return a device as they are built, with about half of the parts; in the hand of an operator with a chance."""
    device = admittance(rng) | {"hold": str(rng.choice(["zoh", "zoh", "lag"]))}
    document = {"device": device, "operator": operator(rng, device, held)}
    problem, faults = problem_at({name: table for name, table in document.items() if table}, "ordinary")
    assert problem is not None, faults
    return problem.device


def ordinary_gains(device: Device, rng: np.random.Generator) -> tuple[Gains, Coupling]:
    """Return gains of a size that may be stable, without an integrator half the time, and a coupling."""
    lag = 1.5 * device.sample_time + device.delay
    velocity = decimal(device.mass / lag * 10 ** rng.uniform(-1.5, -0.2))
    gains = Gains(velocity, decimal(velocity / lag * 10 ** rng.uniform(-3, -1) * int(rng.integers(2))))
    damping = velocity * decades(rng, -1, 1)
    drag = device.damping * decades(rng, -2, 0) * int(rng.integers(2))
    return gains, Coupling(*(decimal(x) for x in (damping, damping * lag * decades(rng, 0, 2), drag)))


ESTIMATES = [None, ("measured", 1), ("measured", 2), ("difference", 0), ("difference", 1), ("difference", 2)]
SENSORS = [None, (0, True), (1, False), (2, False), (1, True), (2, True)]
COMBINATIONS = list(product(ESTIMATES, (0, 1, 2), SENSORS, (False, True)))
"""Velocity's source and filter order, the actuator's order, the force sensor's and whether it is late, structure."""


def with_parts(rng: np.random.Generator, number: int) -> Device:
    """Return a device as they are built with the number-th combination of parts, with any delay or whole samples."""
    estimate, actuator, sensor, bends = COMBINATIONS[number % len(COMBINATIONS)]
    T, mass = decades(rng, -4, -2.7), decades(rng, -1.3, 1)

    def rate(low: float = -1.7, high: float = 0.3) -> float:
        return decades(rng, low, high) / T

    def late() -> float:
        return float(rng.choice([T * rng.uniform(0, 2.5), T * rng.integers(0, 3)]))

    device: dict[str, Any] = {"mass": mass, "sample_time": T, "delay": late()}
    device |= {"damping": mass / T * 10 ** rng.uniform(-4, -1) * (rng.random() < 0.9)}
    if estimate is not None:
        source, order = estimate
        device["velocity"] = {"from": source}
        if order:
            device["velocity"] |= {"filter_hz": min(rate(), 0.49 / T), "filter_order": order}
    if actuator:
        device["actuator"] = {"bandwidth_hz": rate(), "order": actuator}
    if sensor is not None:
        order, delayed = sensor
        device["force_sensor"] = {"delay": late()} if delayed else {}
        if order:
            device["force_sensor"] |= {"bandwidth_hz": rate(), "order": order}
    if bends:
        device["structure"] = {"handle_mass": mass * rng.uniform(0.05, 0.6), "frequency_hz": rate(-1.7, -0.4)}
        device["structure"] |= {"damping_ratio": decades(rng, -2.3, -0.7)}
    problem, faults = problem_at({"device": in_decimals(device)}, "with parts")
    assert problem is not None, faults
    return problem.device


def in_decimals(table: dict[str, Any]) -> dict[str, Any]:
    """Return a table with its floats in six digits."""
    found = {key: decimal(value) if isinstance(value, float) else value for key, value in table.items()}
    return {key: in_decimals(value) if isinstance(value, dict) else value for key, value in found.items()}


def hand_for(device: Device, rng: np.random.Generator) -> Hand:
    """Return a hand from one that is hardly there to one that moves a device as it likes; often without a part."""
    mass, T = device.mass, device.sample_time
    numbers = mass * decades(rng, -2, 1), mass / T * decades(rng, -3, 0.5), mass / T**2 * decades(rng, -5, 1)
    there = rng.random(3) < 0.75
    there[int(rng.integers(3))] = True
    return Hand(*(decimal(x * has) for x, has in zip(numbers, there, strict=True)))
