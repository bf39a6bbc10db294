"""Find how long the loop of a design rings in the hands of a box: eigenvalues of the sampled loop (README.md, "Does it
ring?")."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import pi

import numpy as np
from numpy.typing import NDArray

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.numbers.arithmetic import Floats
from vctune.model.worlds import World
from vctune.proof.claims.claim import Suspect
from vctune.running import check_time
from vctune.simulation.controller import Law
from vctune.simulation.scene import Scene
from vctune.simulation.together import held_by, matrices_of
from vctune.simulation.worlds import NOTHING, RIGID, laws

# Masses, dampings and stiffnesses of hands on the grid (a soft spring alone is slow: they lie close), decades below the
# end of a range that begins at 0, local minima that are refined, and halvings of the distance from them
ON_GRID, DECADES, STARTS, NARROWINGS = (7, 4, 14), 4.0, 6, 8
STANDING = 1e-5  # Distance from 1 within which an eigenvalue belongs to a place without a restoring force
# Distance from -1 of a mode that no motion contains: two masses by the trapezoidal rule that are one
UNHEARD = 1e-9
GONE = 1e-3  # Greatest modulus of an eigenvalue whose motion is over within a sample; rounded zeros are below it
SLOWEST = 2 * pi * 0.1  # Least angular frequency of what shakes a hand, rad/s: what is slower drifts


@dataclass(frozen=True, slots=True)
class Ringing:
    """The oscillation with the least damping ratio."""

    damping_ratio: float  # of s = ln(z)/T: -Re s/|s|; not above 0 if the motion grows
    frequency: float  # Im s, rad/s
    time_constant: float  # -1/Re s, s: after it the motion has fallen to 1/e
    device: Device
    hand: Hand
    world: World


@lru_cache(maxsize=16)  # record, row and warning of a design ask for it
def ringing(
    devices: tuple[Device, ...], hands: Hands, gains: Gains, coupling: AnyCoupling, worlds: tuple[World, ...]
) -> Ringing | None:
    """Return the least damped oscillation of a design on any of the devices, in any hand of a box and before any of the
    environments; None if nothing oscillates. On all but the first device only those that ring most at a corner of the
    box are searched."""
    places = [(device, *each) for device in devices for each in laws(device, gains, coupling, worlds)]
    first, others = places[: len(worlds)], places[len(worlds) :]
    corners = list(dict.fromkeys(hands.corners))

    def at_corners(place: tuple[Device, World, Law]) -> float:
        check_time()
        device, _, law = place
        return float(least_damped(loop_matrices(device, law, corners), device.sample_time)[0].min())

    searched = [*first, *sorted(others, key=at_corners)[: len(worlds)]]
    found = [each for device, world, law in searched for each in _in_hands(device, law, world, hands)]
    return min(found, key=lambda each: each.damping_ratio, default=None)


def least_damped_hand(design: Design, demands: Demands, devices: Sequence[Device]) -> Iterator[Suspect]:
    """Yield the hand in which a design seems to be damped less than is demanded, for `vctune.proof.certificate`."""
    assert demands.hands is not None and demands.damping_ratio is not None
    bare = {device.undisturbed.bare: device for device in devices}
    worlds = (NOTHING,) if demands.worlds is None else tuple(demands.worlds.least_damped)
    worlds = (RIGID,) if demands.rigid else worlds
    found = ringing(tuple(bare), demands.hands, design.gains, design.coupling, worlds)
    if found is not None and found.damping_ratio < demands.damping_ratio:
        theta = found.frequency * found.device.sample_time
        yield Suspect(bare[found.device], found.hand, (theta, theta))


def _in_hands(device: Device, law: Law, world: World, hands: Hands) -> list[Ringing]:
    """Return the least damped oscillation before one environment: on a grid, which narrows around its local minima."""
    check_time()
    low, high = (np.array([float(getattr(end, name)) for name in NAMES]) for end in (hands.low, hands.high))
    axes = [_spread(*ends) for ends in zip(low, high, ON_GRID, strict=True)]
    places = np.array(list(product(*axes)))

    def ratios(places: Floats) -> tuple[Floats, Floats]:
        return least_damped(
            loop_matrices(device, law, [Hand(*map(float, place)) for place in places]), device.sample_time
        )

    ratio, s = ratios(places)
    if not np.isfinite(ratio).any():
        return []
    starts = _local_minima(ratio.reshape([len(axis) for axis in axes]))[:STARTS]
    best = places[starts]
    best_ratio, best_s, reach = (
        ratio[starts],
        s[starts],
        np.array([[_reach(a, x) for a, x in zip(axes, at, strict=True)] for at in best]),
    )
    for _ in range(NARROWINGS):
        steps = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
        tried = np.clip(best[:, None] + steps * reach[:, None], low, high)
        ratio, s = (each.reshape(tried.shape[:2]) for each in ratios(tried.reshape(-1, 3)))
        k, rows = np.argmin(ratio, axis=1), np.arange(len(best))
        better = ratio[rows, k] < best_ratio
        best = np.where(better[:, None], tried[rows, k], best)
        best_ratio, best_s = np.where(better, ratio[rows, k], best_ratio), np.where(better, s[rows, k], best_s)
        reach = reach / 2
    k = int(np.argmin(best_ratio))
    rate = complex(best_s[k])
    time = -1 / rate.real if rate.real else np.inf
    return [Ringing(float(best_ratio[k]), abs(rate.imag), time, device, Hand(*map(float, best[k])), world)]


def _spread(low: float, high: float, count: int) -> list[float]:
    """Return so many values from one end to the other, spaced by logarithm."""
    if low == high:
        return [low]
    first = low if low > 0 else high * 10**-DECADES
    return [*([] if low > 0 else [low]), *map(float, np.geomspace(first, high, count - (low == 0)))]


def _local_minima(values: Floats) -> NDArray[np.intp]:
    """Return the places in a flat grid that are not above their neighbours along the axes, the least first."""
    padded = np.pad(values, 1, constant_values=np.inf)
    inner = tuple(slice(1, -1) for _ in values.shape)
    least = np.isfinite(values)
    for axis in range(values.ndim):
        for shift in (-1, 1):
            least &= values <= np.roll(padded, shift, axis)[inner]
    flat = np.flatnonzero(least)
    return flat[np.argsort(values.ravel()[flat])]


def _reach(axis: list[float], value: float) -> float:
    """Return half of the greatest distance from a value of an axis to its neighbours."""
    k = axis.index(value)
    return max((abs(axis[i] - value) for i in (k - 1, k + 1) if 0 <= i < len(axis)), default=0.0) / 2


def least_damped(matrices: Floats, sample_time: float) -> tuple[Floats, Floats]:
    """Return the damping ratio of the least damped oscillation of each matrix, and its s; inf where nothing
    oscillates."""
    known = np.isfinite(matrices).all(axis=(1, 2), keepdims=True)  # doubles hold no step of some extreme devices
    z = np.linalg.eigvals(np.where(known, matrices, 0.0)).astype(complex)
    with np.errstate(all="ignore"):
        s = np.log(z) / sample_time
        ratio = -s.real / np.abs(s)
    counted = (np.abs(z - 1) > STANDING) & (np.abs(z) > GONE) & (np.abs(s.imag) > SLOWEST)
    counted &= np.abs(z + 1) > UNHEARD
    ratio = np.where(counted, ratio, np.inf)
    k, rows = np.argmin(ratio, axis=1), np.arange(len(z))
    return ratio[rows, k], s[rows, k]


def loop_matrices(device: Device, law: Law, hands: Sequence[Hand]) -> Floats:
    """Return the matrices of a sample's step, shape (hands, n, n), without the states that do not reach the handle."""
    matrices = matrices_of(Scene(device, held_by(hands[0]), None, law, 0.0, 0), hands)
    kept = _reaching((matrices != 0).any(axis=0), [0, 1])  # the motor's position and velocity come first
    return np.asarray(matrices[:, kept][:, :, kept])


def _reaching(acts: NDArray[np.bool_], ends: list[int]) -> NDArray[np.intp]:
    """Return the states from which a chain of actions leads to an end; acts[i, j] tells whether j acts on i."""
    kept = np.zeros(len(acts), bool)
    kept[ends] = True
    for _ in acts:
        kept |= acts[kept].any(axis=0)
    return np.flatnonzero(kept)
