"""Compute the disc around 1 that covers the distance between the measured response and the devices of the box. See
README, section 4."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.box import Bounded
from vctune.identification.response.physics import compliances, held_compliance
from vctune.identification.response.response import Response
from vctune.model.device import Device

TRIED = 600  # Number of devices of the box with which the code compares a line
KNOTS = 24  # Greatest number of frequencies at which the radius is stated
SEED = 1
LEAST = 1e-6  # Least radius, because the logarithmic axes have no 0
MARGIN = 1 + 1e-6  # Relative allowance for the rounding of the numbers in the file


def distances(device: Device, bounds: Sequence[Bounded], measured: Response, coulomb: float) -> Floats:
    """Return the relative difference of each line of the position from the nearest device of the box."""
    is_command, omega = measured.input == "command", measured.position.omega
    needed = np.full(omega.size, np.inf)
    for device_of_box in devices(device, bounds):
        motor = compliances(device_of_box, omega)[0]
        line = measured.position.ratio + motor * coulomb * measured.friction
        model = (
            held_compliance(device_of_box, omega) if is_command else motor * np.exp(-1j * omega * device_of_box.delay)
        )
        needed = np.minimum(needed, np.abs(line / model - 1))
    return needed


def devices(device: Device, bounds: Sequence[Bounded]) -> list[Device]:
    """Return `TRIED` devices of a box: its centre, corners at random, and random devices."""
    has = device.numbers()
    varied = [bounded for bounded in bounds if bounded.key in has]
    random = np.random.default_rng(SEED).uniform(-1, 1, (TRIED, len(varied)))
    random[: TRIED // 2] = np.sign(random[: TRIED // 2])
    random[0] = 0.0
    return [
        device.with_numbers(
            {each.key: each.value * (1 + each.share * at) for each, at in zip(varied, row, strict=True)}
        )
        for row in random
    ]


def covered(
    device: Device, bounds: Sequence[Bounded], radii: Sequence[tuple[float, float]], omega: Floats, *, is_command: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the least and the greatest magnitude and phase over all responses that the file allows."""
    x, y = np.log(np.array(radii)).T
    radius = np.exp(np.interp(np.log(omega / (2 * np.pi)), x, y))
    responses = []
    for device_of_box in devices(device, bounds):
        motor = compliances(device_of_box, omega)[0]
        responses.append(
            held_compliance(device_of_box, omega) if is_command else motor * np.exp(-1j * omega * device_of_box.delay)
        )
    found = np.array(responses)
    turn = np.degrees(np.arcsin(np.minimum(radius, 1.0)))
    phase = np.degrees(np.unwrap(np.angle(-found), axis=1)) - 180.0
    size = np.abs(found)
    return (
        size.min(axis=0) * np.maximum(1 - radius, 0.01),
        size.max(axis=0) * (1 + radius),
        phase.min(axis=0) - turn,
        phase.max(axis=0) + turn,
    )


def envelope(hertz: Floats, needed: Floats) -> tuple[tuple[float, float], ...]:
    """Return a few points (Hz, radius). The polyline through these points on logarithmic axes lies above all required
    radii."""
    count = min(KNOTS, hertz.size)
    knots = np.unique(np.round(np.exp(np.linspace(np.log(hertz[0]), np.log(hertz[-1]), count)), 6))
    segment = np.clip(np.searchsorted(knots, hertz, side="right") - 1, 0, knots.size - 2)
    least = np.array([needed[segment == i].max(initial=LEAST) for i in range(knots.size - 1)])
    around = np.maximum(np.append(least, LEAST), np.append(LEAST, least)) * MARGIN
    return tuple((float(at), float(f"{radius:.6g}")) for at, radius in zip(knots, around * MARGIN, strict=True))


def within(hertz: Floats, needed: Floats, stated: Sequence[tuple[float, float]]) -> bool:
    """Return whether required radii lie within stated radii."""
    x, y = np.log(np.array(stated)).T
    return bool(np.all(np.log(np.maximum(needed, LEAST)) <= np.interp(np.log(hertz), x, y)))
