"""State the condition on a storage function of the sampled loop in a hand whose damping changes (model/README.md,
section 21)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

from vctune.model.device import Device
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, blocked, nothing, product, rows_of, times
from vctune.model.sampled.changing.loop_states import LoopStates

# Names of the functions of a hand that weight the matrices of a storage function (`weights`)
OF_HAND = ("1", "mu", "nu", "sigma", "beta")
BETA = OF_HAND.index("beta")


@dataclass(frozen=True, slots=True)
class Range:
    """The range of an uncertain parameter of the device, by its key, in plain numbers."""

    key: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Holding:
    """Every hand of a box on every device of a box."""

    hands: Hands  # the hands
    numbers: tuple[Range, ...] = ()  # ranges of the device's uncertain parameters

    @property
    def ends(self) -> list[tuple[float, float]]:
        """The two ends of each number: mass, damping and stiffness of the hand, and then those of the device."""
        own = [(float(low), float(high)) for low, high in self.hands.ranges.values()]
        return own + [(each.low, each.high) for each in self.numbers]

    @property
    def dampings(self) -> list[float]:
        """The least and the greatest damping of the hands, without duplicates."""
        return sorted({self.hands.low.damping, self.hands.high.damping})

    def on(self, device: Device, row: Sequence[Number]) -> tuple[Hand, Device]:
        """Return hand and device of the box, from the numbers of `ends`."""
        known = dict(zip((each.key for each in self.numbers), row[3:], strict=True))
        return Hand(*row[:3]), device.with_numbers(known) if known else device


@dataclass(frozen=True, slots=True)
class Storage:
    """A storage function k_eq q^2 + zeta' Y zeta, where Y is a sum of matrices weighted by functions of the hand and of
    the device's uncertain parameters."""

    plain: Device  # device in plain numbers; zeta holds its states
    box: Holding  # box of hands and devices on which the functions are defined
    terms: tuple[tuple[tuple[float, ...], ...], ...]


def terms_of(box: Holding) -> list[str]:
    """Return the names of the functions that weight the matrices of a storage function on a box."""
    return [*OF_HAND, *(each.key for each in box.numbers)]


def moved_mass(device: Device) -> Number:
    """Return the mass of the device that moves rigidly with the hand, kg."""
    return device.mass if device.structure is None else device.structure.handle_mass


def weights(box: Holding, device: Device, hand: Hand, number: Callable[[float], Number]) -> Vector:
    """Return the functions `terms_of` of a hand and a device."""

    def centred(value: Number, low: float, high: float) -> Number:
        return 0 if low == high else (2 * value - number(low) - number(high)) / (number(high) - number(low))

    hands, mass = box.hands, moved_mass(device)
    mu, beta, sigma = (centred(getattr(hand, name), *ends) for name, ends in hands.ranges.items())
    half = 0.5 * (number(hands.low.mass) + number(hands.high.mass))
    nu = 0 if nothing(mu) else (1 - mu * mu) * ((mass + half) / (mass + hand.mass))
    return 1, mu, nu, sigma, beta, *(centred(device.number(each.key), each.low, each.high) for each in box.numbers)


def room_of_storage(loop: LoopStates, Y: Matrix, more: Matrix, ops: Arithmetic) -> Matrix:
    """Return a matrix whose positive definiteness implies that the storage grows by less than 2 v_e y in every
    sample."""
    n, staying, pull = len(Y), loop.staying, loop.pull
    moved = tuple((*row, push) for row, push in zip(loop.change, loop.push, strict=True))
    kept_apart = Y if pull is None else ((0, *Y[0][1:]), *Y[1:])
    stored = product(blocked(kept_apart, ops), blocked(moved, ops))
    after = rows_of(product(blocked(tuple(zip(*moved, strict=True)), ops), stored))
    kept = rows_of(stored)[:staying]

    def entry(i: int, j: int) -> Number:
        if n in (i, j):
            held = 2 * loop.direct - loop.spring if i == j else loop.seen[min(i, j)]
        else:
            held = more[i][j] if max(i, j) < staying else add(Y[i][j], more[i][j])
        stays = [kept[i][j]] if i < staying else []
        stays += [kept[j][i]] if j < staying else []
        grown = [] if pull is None else [times(Y[0][0], pull.grown(i, j))]
        return reduce(add, (times(-1, each) for each in (*stays, after[i][j], *grown)), held)

    return tuple(tuple(entry(i, j) for j in range(n + 1)) for i in range(n + 1))
