"""The proof that a storage function grows by less than the port supplies, in every hand of a box."""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.matrices import Matrix, add, nothing, times
from vctune.model.sampled.changing.loop_states import Law, loop_states
from vctune.model.sampled.changing.storage_function import Storage, moved_mass, room_of_storage, weights
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.array_intervals import UNIT, Enclosure, Floats, between, decimal
from vctune.proof.enclosures.taylor import Taylor, stacked, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.storage.definite import Definite, surely_definite
from vctune.running import check_time

AT_ONCE = 1024
"""Number of boxes that the prover evaluates together. Half or twice this number takes the same time."""


class StorageProof(NamedTuple):
    """The result of a proof.

    Attributes
    ----------
    boxes : number of evaluated boxes
    open : a hand of a box that the prover left open; None if the proof covers every hand
    fails : whether the storage grows by more than the port supplies in that hand, computed in floats
    """

    boxes: int
    open: Hand | None = None
    fails: bool = False


def prove_storage(design: Design, storage: Storage, max_boxes: int) -> StorageProof:
    """Prove a storage function in all hands of a box, for every sensed damping of the box.

    Parameters
    ----------
    design : design; its floats stand for the decimals that they print as
    storage : storage function in decimals, with its box of hands
    max_boxes : number of boxes after which the prover gives up

    Returns
    -------
    StorageProof
        It contains the first hand that fails, or a hand that the prover left open.
    """
    ends = list(storage.hands.ranges.values())
    low, high = (np.array([[float(end[side])] for end in ends]) for side in (0, 1))
    boxes = 0
    while low.shape[1]:
        check_time()
        now, high_now = low[:, :AT_ONCE], high[:, :AT_ONCE]
        boxes += now.shape[1]
        found = _judged(design, storage, now, high_now)
        fails = bool(found.fails.any())
        if fails or (boxes >= max_boxes and not found.proved.all()):
            at = int(np.argmax(found.fails if fails else ~found.proved))
            return StorageProof(boxes, Hand(*(0.5 * (now + high_now))[:, at].tolist()), fails)
        left = ~found.proved
        halves = _halved(now[:, left], high_now[:, left], found.losses[:, left])
        low = np.concatenate([halves[0], low[:, AT_ONCE:]], axis=1)
        high = np.concatenate([halves[1], high[:, AT_ONCE:]], axis=1)
    return StorageProof(boxes)


def _halved(low: Floats, high: Floats, losses: Floats) -> tuple[Floats, Floats]:
    width = high - low
    worth = np.where(width > 0, np.where(np.isfinite(losses), losses, 1.0), -1.0)
    row, at = np.argmax(worth, axis=0), np.arange(low.shape[1])
    below, above, middle = high.copy(), low.copy(), 0.5 * (low + high)[row, at]
    below[row, at] = above[row, at] = middle
    return np.concatenate([low, above], axis=1), np.concatenate([below, high], axis=1)


def _judged(design: Design, storage: Storage, low: Floats, high: Floats) -> Definite:
    """Judge boxes of hands with the least and with the greatest sensed damping, because the matrix is affine in it."""
    value = between(low, high)
    value.rad += 4 * UNIT * np.abs(high)
    rows = variables([Enclosure(mid, rad) for mid, rad in zip(value.mid, value.rad, strict=True)], [True] * len(low))
    hand, exact = Hand(*rows), _enclosed(design)
    Y, matrices = stored(storage, moved_mass(exact[0]), hand), list[Matrix]()
    plain = design.device, Law(design.gains, design.series)
    for sensed in sorted({storage.hands.low.damping, storage.hands.high.damping}):
        more = _lost(storage, hand, sensed)
        loop = loop_states(plain, exact, hand, decimal(sensed), TAYLOR)
        matrices.append(room_of_storage(loop, Y, more, TAYLOR))
    matrices.append(Y if loop.pull is None else _with_spring(Y, exact[0], high[2]))
    found = [surely_definite(_stacked(matrix)) for matrix in matrices]
    return Definite(
        np.all([each.proved for each in found], axis=0),
        np.any([each.fails for each in found[:-1]], axis=0),
        np.max([each.losses for each in found], axis=0),
    )


def _enclosed(design: Design) -> tuple[Device, Law]:
    gains, coupling = (map(decimal, astuple(part)) for part in (design.gains, design.series))
    return design.device.converted(decimal), Law(Gains(*gains), Coupling(*coupling))


def _with_spring(Y: Matrix, device: Device, stiffest: Floats) -> Matrix:
    """Return a lower bound of the storage as a matrix in zeta: p^2/K is least in the stiffest hand of a box.

    Without a spring, p is 0.
    """
    if not stiffest.any():
        return tuple(row[1:] for row in Y[1:])
    T = device.sample_time
    K = Enclosure(stiffest, 4 * UNIT * stiffest) * (T * T) / device.mass
    return (Y[0][0] / K, *Y[0][1:]), *Y[1:]


def _stacked(matrix: Matrix) -> Taylor:
    """Return a matrix of polynomials as a single `Taylor`, shape (m, m, n)."""
    flat = stacked([entry for row in matrix for entry in row])
    m = len(matrix)
    poly, rest = (part.reshape(len(part), m, m, part.shape[-1]) for part in (flat.poly, flat.rest))
    return Taylor(flat.rows, poly, rest)


def _lost(storage: Storage, hand: Hand, sensed: float) -> Matrix:
    """Return by how much Y with the sensed damping exceeds Y with the hand's own damping."""
    low, high = storage.hands.ranges["damping"]
    share: Number = 0 if low == high else 2 * (decimal(sensed) - hand.damping) / (decimal(high) - decimal(low))
    return tuple(tuple(times(share, decimal(x)) for x in row) for row in storage.terms[-1])


def stored(storage: Storage, mass: Number, hand: Hand) -> Matrix:
    """Return an enclosure of Y in a hand.

    Parameters
    ----------
    storage : storage function in decimals
    mass : mass of the device, kg, from `moved_mass`
    hand : the hand; its damping is that of the last sample
    """
    shares = weights(storage.hands, mass, hand, decimal)
    used = [(share, term) for share, term in zip(shares, storage.terms, strict=True) if not nothing(share)]

    def entry(i: int, j: int) -> Number:
        total: Number = 0
        for share, term in used:
            total = add(total, decimal(term[i][j]) * share if share is not shares[0] else decimal(term[i][j]))
        return total

    n = len(storage.terms[0])
    return tuple(tuple(entry(i, j) for j in range(n)) for i in range(n))
