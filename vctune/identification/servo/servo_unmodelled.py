"""Measure the distance of a servo's response from the servos of the box (README, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.box import Bounded
from vctune.identification.response.unmodelled import devices
from vctune.identification.servo.servo_fit import ServoFit
from vctune.identification.servo.servo_motion import Complex, modes, sampled_response
from vctune.identification.servo.servo_study import ServoStudy
from vctune.model.device import Device

RIDGE = 40  # Number of servos that the code tries in addition to random servos
# Number of frequencies up to the Nyquist frequency at which the code compares a servo of the other order with the box
BEYOND = 40


def response_of(device: Device, omega: Floats) -> Complex:
    """Return the response of a servo, from its command to the velocity between samples."""
    servo = device.servo
    assert servo is not None
    return sampled_response(omega, device.sample_time, servo.delay, servo.bandwidth_hz, servo.order)


def servo_distances(device: Device, bounds: Sequence[Bounded], study: ServoStudy) -> Floats:
    """Return the relative distance of each band from the nearest servo of the box."""
    bands = study.bands
    return _nearest(tried_servos(device, bounds, study), 2 * pi * bands.hertz, bands.ratio * bands.fitted)


def off_other_order(device: Device, bounds: Sequence[Bounded], study: ServoStudy) -> tuple[Floats, Floats]:
    """Return frequencies up to the Nyquist frequency, Hz, and the distance of a servo of the other order from the
    box."""
    assert device.servo is not None
    T, other = device.sample_time, study.of_order(3 - device.servo.order)
    hertz = np.geomspace(1e-3, 0.499, BEYOND) / T
    response = sampled_response(2 * pi * hertz, T, other.delay.value, other.bandwidth.value, other.order)
    return hertz, _nearest(tried_servos(device, bounds, study), 2 * pi * hertz, response)


def tried_servos(device: Device, bounds: Sequence[Bounded], study: ServoStudy) -> list[Device]:
    """Return servos of the box. Some of these servos have the latency of a log's fit."""
    assert device.servo is not None
    ends = {
        bounded.key: (bounded.value * (1 - bounded.share), bounded.value * (1 + bounded.share)) for bounded in bounds
    }
    (early, late), (slow, fast) = ends["servo.delay"], ends["servo.bandwidth_hz"]
    order = device.servo.order
    fit = study.of_order(order)
    same_latency = []
    for bandwidth in (*np.geomspace(slow, fast, RIDGE), float(np.clip(fit.bandwidth.value, slow, fast))):
        delay = float(np.clip(_latency(fit) - modes(bandwidth, order)[0], early, late))
        same_latency.append(device.with_numbers({"servo.delay": delay, "servo.bandwidth_hz": float(bandwidth)}))
    return [*devices(device, bounds), *same_latency]


def _latency(fit: ServoFit) -> float:
    """Return the latency of a fit, s: its delay and its lag together."""
    return fit.delay.value + fit.lag


def _nearest(devices_of_box: Sequence[Device], omega: Floats, measured: Complex) -> Floats:
    """Return the relative distance of a response from the nearest of the given servos, at each frequency."""
    distance = np.full(omega.size, np.inf)
    for device in devices_of_box:
        distance = np.minimum(distance, np.abs(measured / response_of(device, omega) - 1))
    return distance
