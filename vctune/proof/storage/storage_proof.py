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
from vctune.model.sampled.changing.storage_function import BETA, Storage, room_of_storage, weights
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.array_intervals import UNIT, Enclosure, Floats, between, decimal
from vctune.proof.enclosures.taylor import Taylor, stacked, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.storage.definite import Definite, surely_definite
from vctune.running import check_time

AT_ONCE = 1024  # Number of boxes that the prover evaluates together
AHEAD = 64  # Number of boxes up to which the prover halves the halves again before it evaluates them


class StorageProof(NamedTuple):
    """The result of a proof."""

    boxes: int  # number of evaluated boxes
    open: Floats | None = None  # parameters of a hand and a device that the prover left open, as in `Holding.ends`
    fails: bool = False  # whether the storage grows by more than the port supplies there, computed in floats


def prove_storage(design: Design, storage: Storage, max_boxes: int) -> StorageProof:
    """Prove a storage function in all hands of a box, for every sensed damping of the box."""
    low, high = (np.array([[end[side]] for end in storage.box.ends]) for side in (0, 1))
    boxes = 0
    while low.shape[1]:
        check_time()
        now, high_now = low[:, :AT_ONCE], high[:, :AT_ONCE]
        boxes += now.shape[1]
        found = _judged(design, storage, now, high_now)
        fails = bool(found.fails.any())
        if fails or (boxes >= max_boxes and not found.proved.all()):
            at = int(np.argmax(found.fails if fails else ~found.proved))
            return StorageProof(boxes, 0.5 * (now + high_now)[:, at], fails)
        left = ~found.proved
        halves = _halved(now[:, left], high_now[:, left], found.losses[:, left])
        low = np.concatenate([halves[0], low[:, AT_ONCE:]], axis=1)
        high = np.concatenate([halves[1], high[:, AT_ONCE:]], axis=1)
    return StorageProof(boxes)


def _halved(low: Floats, high: Floats, losses: Floats) -> tuple[Floats, Floats]:
    """Return the halves of boxes, cut across the row that lowers the bound most. If there are only a few boxes, the
    function halves them several times."""
    worth = np.where(high > low, np.where(np.isfinite(losses), losses, 1.0), 0.0)
    while True:
        row, at = np.argmax(worth, axis=0), np.arange(low.shape[1])
        below, above, middle = high.copy(), low.copy(), 0.5 * (low + high)[row, at]
        below[row, at] = above[row, at] = middle
        low, high = np.concatenate([low, above], axis=1), np.concatenate([below, high], axis=1)
        if not 0 < low.shape[1] <= AHEAD // 2:
            return low, high
        worth[row, at] *= 0.5
        worth = np.tile(worth, 2)


def _judged(design: Design, storage: Storage, low: Floats, high: Floats) -> Definite:
    """Judge boxes of hands with the least and with the greatest sensed damping, because the matrix is affine in it."""
    value = between(low, high)
    value.rad += 4 * UNIT * np.abs(high)
    box, count = storage.box, low.shape[1]
    ends = box.dampings
    value = value[:, np.tile(np.arange(count), len(ends))]
    rows = variables([Enclosure(mid, rad) for mid, rad in zip(value.mid, value.rad, strict=True)], [True] * len(low))
    own, law = _enclosed(design)
    hand, device = box.on(own, rows)
    sensed, plain = decimal(np.repeat(ends, count)), (storage.plain, Law(design.gains, design.series))
    Y, loop = stored(storage, device, hand), loop_states(plain, (device, law), hand, sensed, TAYLOR)
    falls = surely_definite(_stacked(room_of_storage(loop, Y, _lost(storage, hand, sensed), TAYLOR)))
    whole = Y if loop.pull is None else _with_spring(Y, device, np.tile(high[2], len(ends)))
    holds = surely_definite(_stacked(whole).subset(np.s_[:count]))
    proved, fails = (each.reshape(len(ends), count) for each in (falls.proved, falls.fails))
    losses = falls.losses.reshape(len(low), len(ends), count).max(axis=1)
    every = np.asarray(proved.all(axis=0) & holds.proved)
    return Definite(every, np.asarray(fails.any(axis=0)), np.maximum(losses, holds.losses))


def _enclosed(design: Design) -> tuple[Device, Law]:
    gains, coupling = (map(decimal, astuple(part)) for part in (design.gains, design.series))
    return design.device.converted(decimal), Law(Gains(*gains), Coupling(*coupling))


def _with_spring(Y: Matrix, device: Device, stiffest: Floats) -> Matrix:
    """Return a lower bound of the storage as a matrix in zeta: p^2/K is least in the stiffest hand of a box."""
    if not stiffest.any():
        return tuple(row[1:] for row in Y[1:])
    T = device.sample_time
    K = Enclosure(stiffest, 4 * UNIT * stiffest) * (T * T) / device.mass
    return (Y[0][0] / K, *Y[0][1:]), *Y[1:]


def _stacked(matrix: Matrix) -> Taylor:
    """Return a matrix of polynomials as a single `Taylor`, shape (m, m, n)."""
    flat = stacked([entry for row in matrix for entry in row])
    m = len(matrix)
    poly, rest = (part.reshape(len(part), m, m, part.shape[-1]) for part in (flat.coefficients, flat.radii))
    return Taylor(flat.row_count, poly, rest)


def _lost(storage: Storage, hand: Hand, sensed: Number) -> Matrix:
    """Return Y for the sensed damping minus Y for the hand's own damping."""
    low, high = storage.box.hands.ranges["damping"]
    share: Number = 0 if low == high else 2 * (sensed - hand.damping) / (decimal(high) - decimal(low))
    return tuple(tuple(times(share, decimal(x)) for x in row) for row in storage.terms[BETA])


def stored(storage: Storage, device: Device, hand: Hand) -> Matrix:
    """Return an enclosure of Y in a hand."""
    shares = weights(storage.box, device, hand, decimal)
    used = [(share, term) for share, term in zip(shares, storage.terms, strict=True) if not nothing(share)]

    def entry(i: int, j: int) -> Number:
        total: Number = 0
        for share, term in used:
            total = add(total, decimal(term[i][j]) * share if share is not shares[0] else decimal(term[i][j]))
        return total

    n = len(storage.terms[0])
    return tuple(tuple(entry(i, j) for j in range(n)) for i in range(n))
