"""The disc around 1 that covers the distance between the measured response and the devices of the box (README, section
4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.box import Bounded
from vctune.identification.response.physics import compliances, held_compliance
from vctune.identification.response.response import Response
from vctune.model.device import Device

TRIED = 600
"""Devices of the box that a line is compared with: a tenth makes radii a fifth larger on the bench, ten times as many
3 % smaller."""
KNOTS = 24
"""Frequencies at which the radius is stated, where there are more lines."""
SEED = 1
LEAST = 1e-6
MARGIN = 1 + 1e-6
"""Allowance for the rounding of the numbers in the file."""


def distances(device: Device, bounds: Sequence[Bounded], measured: Response, coulomb: float) -> Floats:
    """Return the relative difference of each line of the position from the nearest device of the box.

    Coulomb friction is first subtracted from the line, because it is not linear.

    Parameters
    ----------
    device : device in the middle of the box, without the parts before the recorded force
    bounds : the box; numbers that the device has not got are skipped
    measured : averaged response of a periodic recording
    coulomb : friction, N
    """
    held, omega = measured.input == "command", measured.position.omega
    needed = np.full(omega.size, np.inf)
    for tried in devices(device, bounds):
        motor = compliances(tried, omega)[0]
        line = measured.position.ratio + motor * coulomb * measured.friction
        model = held_compliance(tried, omega) if held else motor * np.exp(-1j * omega * tried.delay)
        needed = np.minimum(needed, np.abs(line / model - 1))
    return needed


def devices(device: Device, bounds: Sequence[Bounded]) -> list[Device]:
    """Return devices of a box: its middle, corners and any others.

    Parameters
    ----------
    device : device in the middle
    bounds : the box; numbers that the device has not got are skipped
    """
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
    device: Device, bounds: Sequence[Bounded], radii: Sequence[tuple[float, float]], omega: Floats, *, held: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return least and greatest size and phase of the responses in the file: a device of the box, times 1 + delta.

    Parameters
    ----------
    device, bounds, radii : as in the file
    omega : frequency, rad/s
    held : whether the force is a command

    Returns
    -------
    tuple of four arrays
        m/N and degrees.
    """
    x, y = np.log(np.array(radii)).T
    radius = np.exp(np.interp(np.log(omega / (2 * np.pi)), x, y))
    responses = []
    for tried in devices(device, bounds):
        motor = compliances(tried, omega)[0]
        responses.append(held_compliance(tried, omega) if held else motor * np.exp(-1j * omega * tried.delay))
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
    """Return a few points whose straight line on logarithmic axes lies above all radii that are needed.

    Parameters
    ----------
    hertz, needed : shape (n,), increasing frequencies and radii
    """
    count = min(KNOTS, hertz.size)
    knots = np.unique(np.round(np.exp(np.linspace(np.log(hertz[0]), np.log(hertz[-1]), count)), 6))
    segment = np.clip(np.searchsorted(knots, hertz, side="right") - 1, 0, knots.size - 2)
    least = np.array([needed[segment == i].max(initial=LEAST) for i in range(knots.size - 1)])
    around = np.maximum(np.append(least, LEAST), np.append(LEAST, least)) * MARGIN
    return tuple((float(at), float(f"{radius:.6g}")) for at, radius in zip(knots, around * MARGIN, strict=True))


def within(hertz: Floats, needed: Floats, stated: Sequence[tuple[float, float]]) -> bool:
    """Return whether radii that are needed are within those that are stated.

    Parameters
    ----------
    hertz : frequencies of the lines, Hz, shape (n,)
    needed : radius of each, relative, shape (n,)
    stated : (Hz, radius) of a device file, straight between them on logarithmic axes
    """
    x, y = np.log(np.array(stated)).T
    return bool(np.all(np.log(np.maximum(needed, LEAST)) <= np.interp(np.log(hertz), x, y)))
