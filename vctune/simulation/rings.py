"""Find how long the loop of a design rings in the hands of a box: eigenvalues of the sampled loop (README.md, "Does it
ring?")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.numbers.arithmetic import Floats
from vctune.model.worlds import World
from vctune.running import check_time
from vctune.simulation.controller import Law
from vctune.simulation.scene import Scene
from vctune.simulation.together import held_by, together
from vctune.simulation.worlds import laws

# Numbers of a hand on the grid, decades below its end of one whose range begins at 0, and narrowings of the grid around
# its worst hand
SHARES, DECADES, NARROWINGS = 7, 4.0, 4
STANDING = 1e-5  # Distance from 1 within which an eigenvalue belongs to a place without a restoring force
LEAST = 1e-9  # Least angle of an oscillation, rad per sample


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
    environments; None if nothing oscillates."""
    found = list[Ringing]()
    for device in devices:
        for world, law in laws(device, gains, coupling, worlds):
            check_time()
            found += _in_hands(device, law, world, hands)
    return min(found, key=lambda each: each.damping_ratio, default=None)


def _in_hands(device: Device, law: Law, world: World, hands: Hands) -> list[Ringing]:
    """Return the least damped oscillation before one environment: on a grid that narrows around its worst hand."""
    low, high = ([float(getattr(end, name)) for name in NAMES] for end in (hands.low, hands.high))
    grid = [_shares(*ends) for ends in zip(low, high, strict=True)]
    best: tuple[float, complex, tuple[float, ...]] | None = None
    for _ in range(NARROWINGS + 1):
        places = list(product(*grid))
        least = least_damped(loop_matrices(device, law, [Hand(*place) for place in places]))
        k = int(np.argmin([ratio for ratio, _ in least]))
        if not np.isfinite(least[k][0]):
            return []
        if best is None or least[k][0] < best[0]:
            best = (*least[k], places[k])
        grid = [_near(axis, value) if len(axis) > 1 else axis for axis, value in zip(grid, best[2], strict=True)]
    assert best is not None
    ratio, s = best[0], best[1] / device.sample_time
    return [Ringing(ratio, abs(s.imag), -1 / s.real if s.real else np.inf, device, Hand(*best[2]), world)]


def _shares(low: float, high: float) -> list[float]:
    """Return values from one end to the other, spaced by logarithm."""
    if low == high:
        return [low]
    first = low if low > 0 else high * 10**-DECADES
    return [*([] if low > 0 else [low]), *map(float, np.geomspace(first, high, SHARES - (low == 0)))]


def _near(axis: list[float], value: float) -> list[float]:
    """Return values between the neighbours of a value on an axis."""
    k = axis.index(value) if value in axis else int(np.argmin(np.abs(np.array(axis) - value)))
    return [float(v) for v in np.unique([*np.linspace(axis[max(k - 1, 0)], axis[min(k + 1, len(axis) - 1)], 5), value])]


def least_damped(matrices: Floats) -> list[tuple[float, complex]]:
    """Return the damping ratio of the least damped oscillation of each matrix, and its s T; inf where nothing
    oscillates."""
    z = np.linalg.eigvals(matrices).astype(complex)
    with np.errstate(all="ignore"):
        s = np.log(z)
        ratio = -s.real / np.abs(s)
    counted = (np.abs(z - 1) > STANDING) & (np.abs(s.imag) > LEAST) & np.isfinite(ratio)
    ratio = np.where(counted, ratio, np.inf)
    k = np.argmin(ratio, axis=1)
    rows = np.arange(len(z))
    return list(zip(map(float, ratio[rows, k]), map(complex, s[rows, k]), strict=True))


def loop_matrices(device: Device, law: Law, hands: Sequence[Hand]) -> Floats:
    """Return the matrices of a sample's step from state to state, shape (hands, n, n), without the states that do not
    reach the handle."""
    scene = Scene(device, held_by(hands[0]), None, law, 0.0, 0)
    one = together(scene, hands)
    start = one.start
    size, count = sum(map(len, start.values())), len(hands)
    all_units = one.of(np.repeat(np.arange(count), size))
    units = np.tile(np.eye(size), (1, count))  # (size, hands * size)
    now, k = dict[str, list[Floats]](), 0
    for name, numbers in start.items():
        now[name], k = list(units[k : k + len(numbers)]), k + len(numbers)
    after, _ = all_units.advance(now, 0.0)
    rows = [np.broadcast_to(number, (count * size,)) for numbers in after.values() for number in numbers]
    matrices = np.moveaxis(np.array(rows, float).reshape(size, count, size), 1, 0)
    kept = _reaching((matrices != 0).any(axis=0), [k for k, _ in enumerate(one.moving.states)][:2])
    return np.asarray(matrices[:, kept][:, :, kept])


def _reaching(acts: NDArray[np.bool_], ends: list[int]) -> NDArray[np.intp]:
    """Return the states from which a chain of actions leads to an end; acts[i, j] tells whether j acts on i."""
    kept = np.zeros(len(acts), bool)
    kept[ends] = True
    for _ in acts:
        kept |= acts[kept].any(axis=0)
    return np.flatnonzero(kept)
