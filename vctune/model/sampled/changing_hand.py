"""The sampled loop in a hand whose damping changes, as states, and what a storage function of them must meet
(model/README.md, section 20).

All numbers are dimensionless, in units of the sample time T and of the device's mass m. The states xi are the position
x, the velocity v, the commands u[k-1] ... u[k-N-1] that still act or were the last to act, the position q that v_e has
reached, and the coupling's g. With v_e = 0 the loop rests wherever q is, at x = kappa q and u = k_eq q. The states zeta
less those of that rest do without q.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from vctune.model.coupling import trapezoidal
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, blocked, product, rows_of, times
from vctune.model.sampled.plant_in_hand import Delays, delays_of
from vctune.model.sampled.state_space import stepped

TERMS = ("1", "M/m", "m/(m + M)", "K T^2/m")
"""The functions of a hand of which a storage function is made."""


class LoopStates(NamedTuple):
    """zeta[k+1] = step zeta[k] + push v_e[k], and the port y = Z_c v_e - f = seen zeta + spring q + direct v_e.

    Attributes
    ----------
    step, push, seen : n x n, n and n numbers
    direct : response of y to v_e at once
    spring : k_eq, of the hand's spring and K_p in series
    """

    step: Matrix
    push: Vector
    seen: Vector
    direct: Number
    spring: Number


@dataclass(frozen=True, slots=True)
class Storage:
    """A storage function (k_eq/T) q^2 + zeta' Y zeta, Y = Y_0 + (M/m) Y_1 + m/(m + M) Y_2 + (K T^2/m) Y_3.

    Attributes
    ----------
    terms : the symmetric matrices Y_0 to Y_3, dimensionless, as decimals
    """

    terms: tuple[tuple[tuple[float, ...], ...], ...]


def weights(device: Device, hand: Hand) -> Vector:
    """Return the functions `TERMS` of a hand.

    Parameters
    ----------
    device, hand : in numbers of one arithmetic
    """
    mass, T = device.mass, device.sample_time
    return 1, hand.mass / mass, mass / (mass + hand.mass), hand.stiffness * (T * T) / mass


def states_of(device: Device) -> list[str]:
    """Return the names of the states zeta of a device whose numbers are plain."""
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
        free = (*(add(step[i][j], int(i == j)) for j in (0, 1)), *((0,) * n), older[i], 0)
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


def room_of_storage(loop: LoopStates, Y: Matrix, ops: Arithmetic) -> Matrix:
    """Return the matrix that is positive definite where the storage grows by less than 2 v_e y in every sample.

    The part of q is (k_eq/T) q^2 and drops out: its growth is k_eq (2 q + v_e) v_e, of which y has 2 k_eq q v_e.

    Parameters
    ----------
    loop : n states
    Y : symmetric, n x n
    ops : arithmetic of both

    Returns
    -------
    Matrix
        (n + 1) x (n + 1), of zeta and v_e.
    """
    n = len(Y)
    moved = tuple((*row, push) for row, push in zip(loop.step, loop.push, strict=True))
    stored = product(blocked(Y, ops), blocked(moved, ops))
    after = rows_of(product(blocked(tuple(zip(*moved, strict=True)), ops), stored))
    before = [[*row, seen] for row, seen in zip(Y, loop.seen, strict=True)]
    before.append([*loop.seen, 2 * loop.direct - loop.spring])
    return tuple(tuple(add(before[i][j], times(-1, after[i][j])) for j in range(n + 1)) for i in range(n + 1))
