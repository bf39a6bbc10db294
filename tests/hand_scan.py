"""The demand in the hands of a problem by the oracle of the sampled device alone, hand by hand."""

from __future__ import annotations

from dataclasses import astuple
from itertools import product

import numpy as np
from arithmetic import DOUBLES
from device_oracle import Coupling, Gains, read_device
from sampled_device_oracle import Hand, circle, coupling_at, seen_at, sensitivity
from servo_oracle import Follower, Grip, Virtual, seen, vertices
from servo_oracle import coupling as servo_coupling

FREQUENCIES, OTHERS = 60, 4
"""Frequencies up to Nyquist, and random hands beside the vertices of the box."""


def least_ratio_in_hands(path, problem, judgement):
    """Return the least Re Z_c / R, and the greatest |S| of the device let go; a servo's |S| is 1."""
    if problem.device.servo is not None:
        return least_ratio_of_servo(problem, judgement), 1.0
    real = read_device(path)
    gains, coupling = Gains(*astuple(judgement.gains)), Coupling(*astuple(judgement.coupling))
    rng, ends = np.random.default_rng(3), [*zip(astuple(problem.hands.low), astuple(problem.hands.high), strict=True)]
    hands = [Hand(*corner) for corner in product(*ends)]
    hands += [Hand(*(rng.uniform(*each) for each in ends)) for _ in range(OTHERS)]
    ratios, peak = [np.inf], 0.0
    for hertz in np.geomspace(1e-3, 0.5 / real.sample_time * (1 - 1e-9), FREQUENCIES):
        z = circle(real, hertz, DOUBLES)
        Z_c = coupling_at(real, coupling, z, DOUBLES).real
        required = max(-seen_at(real, gains, hand, z, DOUBLES).real for hand in hands)
        ratios += [Z_c / required] if required > 0 else []
        peak = max(peak, abs(sensitivity(real, gains, hertz, DOUBLES)))
    return min(ratios), peak


def least_ratio_of_servo(problem, judgement):
    """Return the least Re Z_c / R over the vertices of the box of hands; R is convex in the hand."""
    device, servo, sensing = problem.device, problem.device.servo, problem.device.sensing
    follower = Follower(
        device.sample_time,
        device.delay,
        servo.bandwidth_hz,
        servo.order,
        servo.command == "position",
        sensing.bandwidth_hz,
        sensing.order,
        sensing.delay,
    )
    theta = np.geomspace(1e-4, np.pi * (1 - 1e-9), FREQUENCIES)
    Z_c = servo_coupling(Virtual(*astuple(judgement.coupling)), device.sample_time, theta).real
    ends = (Grip(*astuple(end)) for end in (problem.hands.low, problem.hands.high))
    required = np.max([-seen(follower, hand, theta).real for hand in vertices(*ends)], axis=0)
    return float(np.min(Z_c[required > 0] / required[required > 0]))
