"""Compute the drag that a servo's latency requires, and the stiffest contact, in double precision (README.md, section
2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi

import numpy as np

from vctune.analysis.extrema import Floats, local_minima
from vctune.analysis.multiples import least_ratio_in_worlds
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import offered
from vctune.model.sampled.servo_in_hand import Demand, demand_of
from vctune.model.worlds import Worlds
from vctune.running import check_time

LOWEST = 1e-3  # Least angle omega T above 0, rad
PER_DECADE = 120  # Number of angles per decade


NO_GAINS = Gains(0.0, 0.0)
DOUBLINGS = 60  # Number of doublings of a stiffness that is borne
SHARE = 1e-8  # Share of a stiffness to which it is found


@dataclass(frozen=True, slots=True)
class Greatest:
    """The greatest drag that the hands of a box require."""

    drag: float  # greatest R, N s/m; a coupling without damping and mass needs this drag
    omega: float  # frequency of the greatest R, rad/s
    hand: Hand  # hand that requires the greatest R


def drag_at_rest(devices: Sequence[Device], hands: Hands) -> float:
    """Return the greatest R at rest, K L minus the least damping, N s/m. No coupling with less drag is stable."""
    return max(0.0, *(_at_rest(device, hands) for device in devices))


def _at_rest(device: Device, hands: Hands) -> float:
    check_time()
    return float(demand_of(device, hands).at(np.zeros(1))[0])


def greatest_drag(devices: Sequence[Device], hands: Hands) -> Greatest:
    """Return the greatest drag that the hands of a box require at any frequency."""
    return max((_greatest(device, demand_of(device, hands), hands) for device in devices), key=_drag)


def _drag(found: Greatest) -> float:
    return found.drag


def _greatest(device: Device, demand: Demand, hands: Hands) -> Greatest:
    place = local_minima(lambda theta: -demand.at(theta), _angles(device))
    theta = np.array([0.0, place.omega[0]])
    asked = demand.in_each(theta)
    vertex, at = np.unravel_index(int(np.argmax(asked)), asked.shape)
    return Greatest(float(asked[vertex, at]), float(theta[at]) / device.sample_time, hands.corners[vertex])


def stiffest_contact(
    devices: Sequence[Device], hands: Hands, coupling: AnyCoupling, factor: float, worlds: Worlds | None = None
) -> float:
    """Return the greatest contact stiffness, N/m, up to which a coupling is stable with every mass and damping of the
    box, with every passive environment or with those of a box."""
    if worlds is None:
        return min(_stiffest(device, hands, coupling, factor) for device in devices)

    def spare(device: Device, stiffness: float) -> float:
        low = replace(hands.low, stiffness=min(hands.low.stiffness, stiffness))
        softer = Hands(low, replace(hands.high, stiffness=stiffness))
        ratio = least_ratio_in_worlds(device, softer, NO_GAINS, coupling, worlds).ratio
        return max(1 - factor / ratio, -1.0) if ratio > 0 else -1.0

    least = inf
    for device in devices:
        least = _last_borne(partial(spare, device), hands, least)
    return least


def _stiffest(device: Device, hands: Hands, coupling: AnyCoupling, factor: float) -> float:
    """Return the least stiffness, over all angles, for which the required resistance equals Re Z_c of the coupling."""
    if device.servo is not None and device.servo.radii:
        return _stiffest_in_disc(device, hands, coupling, factor)
    least, unit = hands.low.stiffness, max(hands.high.stiffness, 1.0)
    soft, stiff = (
        Hands(replace(hands.low, stiffness=k), replace(hands.high, stiffness=k)) for k in (least, least + unit)
    )
    without, with_unit = (demand_of(device, box) for box in (soft, stiff))

    def room(theta: Floats) -> Floats:
        shape, flat = np.shape(theta), np.ravel(theta)
        base, Z_c = without.in_each(flat), offered(coupling, device, flat, FLOATS)
        slope, left = with_unit.in_each(flat) - base, Z_c / factor - base
        with np.errstate(all="ignore"):
            bears = np.where(slope > 0, left / slope, np.where(left < 0, -inf, inf))
        return np.asarray(least + unit * bears.min(axis=0)).reshape(shape)

    return min(float(room(np.zeros(1))[0]), float(local_minima(room, _angles(device)).value[0]))


def _stiffest_in_disc(device: Device, hands: Hands, coupling: AnyCoupling, factor: float) -> float:
    theta = _angles(device)
    room = offered(coupling, device, theta, FLOATS) / factor

    def spare(stiffness: float) -> float:
        low, high = (replace(end, stiffness=stiffness) for end in (hands.low, hands.high))
        return float(np.min(room - demand_of(device, Hands(low, high)).at(theta)))

    return _last_borne(spare, hands)


def _last_borne(spare: Callable[[float], float], hands: Hands, most: float = inf) -> float:
    """Return the greatest stiffness up to `most` that leaves something to spare; inf without a limit, -inf if that of
    the softest hand leaves nothing."""
    from scipy.optimize import brentq

    low, high = hands.low.stiffness, min(max(hands.high.stiffness, 1.0), most)
    if most == -inf or spare(low) < 0:
        return -inf
    for _ in range(DOUBLINGS):
        if spare(high) < 0:
            return float(brentq(spare, low, high, xtol=SHARE * high, rtol=SHARE))
        if high == most:
            return most
        low, high = high, min(2 * high, most)
    return inf


def _angles(device: Device) -> Floats:
    """Return angles up to Nyquist."""
    servo = device.servo
    assert servo is not None
    turns = 4 + device.sensed_latency / device.sample_time
    decades = np.geomspace(LOWEST, pi, int(PER_DECADE * np.log10(pi / LOWEST)))
    return np.union1d(decades, np.linspace(0.0, pi, int(16 * turns) + 1)[1:])
