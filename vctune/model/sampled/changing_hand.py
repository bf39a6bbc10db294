"""State-space form of the sampled loop in a hand whose damping changes, and the condition on a storage function
(model/README.md, section 21).

All numbers are dimensionless, in units of the sample time T and of the device's mass m. The states xi are the position
x, the velocity v, the commands u[k-1] ... u[k-N-1] that still act or were the last to act, the position q that v_e has
reached, and the coupling's g. With v_e = 0 the loop rests wherever q is, at x = kappa q and u = k_eq q. The states zeta
are the deviations of the other states from this rest; q is not among them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

from vctune.model.coupling import trapezoidal
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, blocked, nothing, product, rows_of, times
from vctune.model.sampled.plant_in_hand import Delays, delays_of
from vctune.model.sampled.state_space import stepped

TERMS = ("1", "mu", "nu", "sigma", "beta")
"""Names of the functions of a hand that weight the matrices of a storage function. Each lies between -1 and 1 in a
box."""


STAYING = 2
"""Number of states that change little in a sample: x and v."""


class LoopStates(NamedTuple):
    """zeta[k+1] = (x, v, 0 ...) + change zeta[k] + push v_e[k], y = Z_c v_e - f = seen zeta + spring q + direct v_e.

    Attributes
    ----------
    change : zeta[k+1] minus x and v of sample k, because these two change little in a sample
    push, seen : n numbers each
    direct : immediate response of y to v_e
    spring : k_eq, of the hand's spring and K_p in series
    """

    change: Matrix
    push: Vector
    seen: Vector
    direct: Number
    spring: Number


@dataclass(frozen=True, slots=True)
class Storage:
    """A storage function k_eq q^2 + zeta' Y zeta, Y = Y_0 + mu Y_1 + nu Y_2 + sigma Y_3 + beta Y_4.

    Attributes
    ----------
    hands : box of hands on which the functions mu, nu, sigma and beta are defined
    terms : the symmetric matrices Y_0 to Y_4, dimensionless, as decimals
    """

    hands: Hands
    terms: tuple[tuple[tuple[float, ...], ...], ...]


def weights(hands: Hands, mass: Number, hand: Hand, number: Callable[[float], Number]) -> Vector:
    """Return the functions `TERMS` of a hand.

    mu, sigma and beta are mass, stiffness and damping, scaled from their ranges to -1 to 1. nu is 0 at both ends of the
    range of masses. 1/(m + M) is a linear combination of 1, mu and nu.

    Parameters
    ----------
    hands : box, in plain numbers
    mass : m of the device
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


def states_of(device: Device) -> list[str]:
    """Return the names of the states zeta. The device's numbers must be plain."""
    past = [f"u[k-{back}] - k_eq q" for back in range(1, int(delays_of(device).loop) + 2)]
    return ["x - kappa q", "v", *past, "g"]


def loop_states(
    device: Device, gains: Gains, coupling: Coupling, hand: Hand, sensed: Number, delays: Delays, ops: Arithmetic
) -> LoopStates:
    """Sample a rigid device with its velocity loop in a hand exactly.

    Parameters
    ----------
    device : without parts
    gains : K_v and K_p, K_p > 0
    coupling : b_c, m_c and b_0
    hand : from this sample to the next
    sensed : damping of the hand when the force is sampled, which may be another one, N s/m
    delays : whole samples of the device's delay
    ops : arithmetic of all of these

    Returns
    -------
    LoopStates
        Dimensionless.
    """
    T, m, n = device.sample_time, device.mass, int(delays.loop)
    unit = T / m
    carried, k, k_p = hand.mass / m, hand.stiffness * (T * unit), gains.position * (T * unit)
    inertia, own, k_v = 1 + carried, device.damping * unit, gains.velocity * unit
    kappa = k_p / (k + k_p)
    spring = k * kappa
    rates: Matrix = (
        (0, 0 * inertia + 1, 0),
        (-k / inertia, -(own + hand.damping * unit) / inertia, 1 / inertia),
        (0, 0, 0),
    )
    left = (device.delay - n * T) / T if delays.loop_fractional else None
    step, newer, older = stepped(rates, left, ops)
    law: Vector = (-k_p, -k_v, *((0,) * (n + 2)))
    law_push = k_v + 0.5 * k_p
    rows, push = list[Vector](), list[Number]()
    for i in (0, 1):
        free = (*step[i][:2], *((0,) * n), older[i], 0)
        command = law if n == 0 else tuple(int(j == 1 + n) for j in range(n + 4))
        rows.append(tuple(add(own_part, times(newer[i], share)) for own_part, share in zip(free, command, strict=True)))
        push.append(newer[i] * law_push if n == 0 else 0)
    push[0] = add(push[0], -kappa)
    slope, decay = trapezoidal(coupling, T)
    rows += [law, *(tuple(int(j == 2 + back) for j in range(n + 4)) for back in range(n)), (*((0,) * (n + 3)), decay)]
    push += [law_push - spring, *((-spring,) * n), 1]
    felt, share = sensed * unit, carried / inertia
    seen = (k - share * k, felt - share * (own + felt), *((0,) * n), share, -(slope * unit) * (1 - decay))
    return LoopStates(tuple(rows), tuple(push), seen, (slope + coupling.drag) * unit, spring)


def room_of_storage(loop: LoopStates, Y: Matrix, more: Matrix, ops: Arithmetic) -> Matrix:
    """Return a matrix. If it is positive definite, the storage grows by less than 2 v_e y in every sample.

    The term k_eq q^2 of the storage grows by k_eq (2 q + v_e) v_e. The part 2 k_eq q v_e cancels against the same part
    of 2 v_e y, so q drops out.

    Parameters
    ----------
    loop : n states
    Y : matrix of the storage for the damping from now on, symmetric, n x n
    more : the matrix for the damping at the time of the sampling, minus Y
    ops : arithmetic of both

    Returns
    -------
    Matrix
        (n + 1) x (n + 1), of zeta and v_e.
    """
    n = len(Y)
    moved = tuple((*row, push) for row, push in zip(loop.change, loop.push, strict=True))
    stored = product(blocked(Y, ops), blocked(moved, ops))
    after = rows_of(product(blocked(tuple(zip(*moved, strict=True)), ops), stored))
    kept = rows_of(stored)[:STAYING]

    def entry(i: int, j: int) -> Number:
        if n in (i, j):
            held = 2 * loop.direct - loop.spring if i == j else loop.seen[min(i, j)]
        else:
            held = more[i][j] if max(i, j) < STAYING else add(Y[i][j], more[i][j])
        stays = [kept[i][j]] if i < STAYING else []
        stays += [kept[j][i]] if j < STAYING else []
        return reduce(add, (times(-1, each) for each in (*stays, after[i][j])), held)

    return tuple(tuple(entry(i, j) for j in range(n + 1)) for i in range(n + 1))
