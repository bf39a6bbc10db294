"""Evaluate what a storage function must meet in a hand whose damping changes (model/README.md, section 21)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

from vctune.model.device import Device
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, blocked, nothing, product, rows_of, times
from vctune.model.sampled.changing.loop_states import LoopStates

TERMS = ("1", "mu", "nu", "sigma", "beta")
"""The functions of a hand of which a storage function is made, each between -1 and 1 in a box."""


@dataclass(frozen=True, slots=True)
class Storage:
    """A storage function k_eq q^2 + zeta' Y zeta, Y = Y_0 + mu Y_1 + nu Y_2 + sigma Y_3 + beta Y_4.

    With K_p = 0 the first of zeta is the force p of the hand's spring, and the first entry of Y stands for p^2/K.

    Attributes
    ----------
    hands : box of hands to which its functions refer
    terms : the symmetric matrices Y_0 to Y_4, dimensionless, as decimals
    """

    hands: Hands
    terms: tuple[tuple[tuple[float, ...], ...], ...]


def moved_mass(device: Device) -> Number:
    """Return the mass that the hand moves at once, kg."""
    return device.mass if device.structure is None else device.structure.handle_mass


def weights(hands: Hands, mass: Number, hand: Hand, number: Callable[[float], Number]) -> Vector:
    """Return the functions `TERMS` of a hand.

    mu, sigma and beta are the mass, the stiffness and the damping from -1 to 1 in their ranges. nu is 0 at both ends of
    the masses; with 1 and mu it makes 1/(m + M), m the mass that the hand moves.

    Parameters
    ----------
    hands : box, in plain numbers
    mass : of the device, see `moved_mass`
    hand : its damping is that of the last sample
    number : a plain number in the arithmetic of mass and hand

    Returns
    -------
    Vector
        A function of a number that the box does not vary is the integer 0.
    """

    def centred(name: str) -> Number:
        low, high = hands.ranges[name]
        return (
            0 if low == high else (2 * getattr(hand, name) - number(low) - number(high)) / (number(high) - number(low))
        )

    mu = centred("mass")
    half = 0.5 * (number(hands.low.mass) + number(hands.high.mass))
    nu = 0 if nothing(mu) else (1 - mu * mu) * ((mass + half) / (mass + hand.mass))
    return 1, mu, nu, centred("stiffness"), centred("damping")


def room_of_storage(loop: LoopStates, Y: Matrix, more: Matrix, ops: Arithmetic) -> Matrix:
    """Return the matrix that is positive definite where the storage grows by less than 2 v_e y in every sample.

    The part of q is k_eq q^2 and drops out: its growth is k_eq (2 q + v_e) v_e, of which y has 2 k_eq q v_e.

    Parameters
    ----------
    loop : n states
    Y : for the damping from now on, symmetric, n x n
    more : what Y had more for the damping when the force was sampled
    ops : arithmetic of both

    Returns
    -------
    Matrix
        (n + 1) x (n + 1), of zeta and v_e.
    """
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
