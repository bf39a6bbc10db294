"""Find a candidate for a storage function that serves all dampings of a hand. The search runs in floats, and rounds its
result to decimals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.matrices import Matrix
from vctune.model.sampled.changing.loop_states import Law, LoopStates, loop_states
from vctune.model.sampled.changing.storage_function import BETA, Holding, Storage, moved_mass, weights
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.array_intervals import TINY, Floats
from vctune.proof.storage.barrier import Family, Sums, well_inside

ACROSS = 3  # Number of dampings, and number of stiffnesses, in the grid of hands for the first candidate
DIGITS = 14  # Significant digits of the decimals
# Number of doublings of the time over which noise drives the states: 2^60 samples, after which the states of every
# stable loop are stationary
DOUBLINGS = 60

# Hands and devices for which the search needs a storage function, each with the sensed damping: the damping of the hand
# when the sensor sampled the force
Places = Floats


def vertices(box: Holding) -> Places:
    """Return the vertices of a box of hands and devices."""
    return _all_of([_different(ends) for ends in box.ends], box)


def grid(design: Design, box: Holding) -> Places:
    """Return a grid of hands over the whole box, on the devices at its vertices."""
    masses, dampings, stiffnesses, *numbers = box.ends
    own = moved_mass(design.device)
    low, high = (own + mass for mass in masses)
    # a third and two thirds of the range, and half of the range of 1/(m + M)
    between = [(2 * low + high) / 3, (low + 2 * high) / 3, 2 * low * high / (low + high)]
    inner = [mass - own for mass in between if low < high]
    across = [np.linspace(*ends, ACROSS).tolist() for ends in (dampings, stiffnesses)]
    return _all_of([_different(axis) for axis in ([*masses, *inner], *across, *numbers)], box)


def _different(numbers: Sequence[float]) -> list[float]:
    return sorted(set(numbers))


def _all_of(axes: list[list[float]], box: Holding) -> Places:
    return np.array(list(product(*axes, box.dampings))).T


def joined(at: Places, row: Floats, box: Holding) -> Places:
    """Return these places and one more, both with the least and with the greatest sensed damping."""
    return np.concatenate([at, _all_of([[number] for number in row.tolist()], box)], axis=1)


def candidate(design: Design, box: Holding, at: Places) -> Storage | None:
    """Return a storage that grows by less than the port supplies at given places; None if the search finds none."""
    sums, basis = _affine(design, box, at)
    found = well_inside(sums)
    if found is None:
        return None
    terms = np.tensordot(found, basis, axes=1)
    decimals = tuple(tuple(tuple(_rounded(x) for x in row) for row in term) for term in terms.tolist())
    return Storage(design.device, box, decimals)


def hand_without(design: Design, box: Holding) -> Hand | None:
    """Return a corner of the masses and stiffnesses for which the search finds no storage for all dampings."""
    for corner in box.hands.corners:
        if corner.damping < box.hands.high.damping:
            continue
        fixed = Holding(Hands(replace(corner, damping=box.hands.low.damping), corner))
        if candidate(design, fixed, grid(design, fixed)) is None:
            return corner
    return None


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")


def _affine(design: Design, box: Holding, at: Places) -> tuple[Sums, Floats]:
    """Return the inequality at each place as a matrix that is affine in the entries of Y (model/README.md, section
    21)."""
    law, count, sensed = Law(design.gains, design.series), at.shape[1], at[-1]
    hand, device = box.on(design.device, list(at[:-1]))
    loop = loop_states((design.device, law), (device, law), hand, sensed, FLOATS)
    n = len(loop.push)
    moved = _stacked(tuple((*row, push) for row, push in zip(loop.change, loop.push, strict=True)), count)
    weights_before, weights_after = (
        _stacked((weights(box, device, each, float),), count)[:, 0] for each in (replace(hand, damping=sensed), hand)
    )
    constant = np.zeros((count, n + 1, n + 1))
    constant[:, :n, n] = constant[:, n, :n] = _stacked((loop.seen,), count)[:, 0]
    constant[:, n, n] = 2 * loop.direct - loop.spring
    unit = _units(moved[count // 2], loop.staying, constant[count // 2, n, n])
    rows, columns = np.triu_indices(n)
    basis = np.zeros((rows.size, n, n))
    basis[np.arange(rows.size), rows, columns] = basis[np.arange(rows.size), columns, rows] = 1.0
    basis /= np.outer(unit[:n], unit[:n])
    stays, held = np.eye(n, n + 1) * (np.arange(n) < loop.staying)[:, None], np.zeros((rows.size, n + 1, n + 1))
    held[:, :n, :n] = basis
    crossed = stays.T @ basis @ moved[:, None]
    # Y - F' Y F from the changes of the states alone, so that the constant parts cancel before rounding
    grown = crossed + crossed.swapaxes(-1, -2) + moved.swapaxes(1, 2)[:, None] @ basis @ moved[:, None]
    kept = held - stays.T @ basis @ stays - grown
    after, free = held - kept, np.ones((weights_after.shape[1], rows.size), bool)
    if loop.pull is not None:
        kept[:, 0], after[:, 0] = -_grown(loop, count) * basis[0, 0, 0], 0.0
        free[BETA, 0] = False
    across = np.outer(unit, unit)
    families = Family(weights_before, kept * across), Family(weights_before - weights_after, after * across)
    return Sums(constant * across, families, free), basis


def _units(moved: Floats, staying: int, direct: float) -> Floats:
    """Return the size of each state, and of v_e, of a loop that noise drives; in these units all have the same size."""
    n = len(moved)
    step, push = moved[:, :n] + np.diag(np.arange(n) < staying), moved[:, n:] / np.sqrt(abs(direct) + TINY)
    spread = push @ push.T
    with np.errstate(all="ignore"):
        for _ in range(DOUBLINGS):
            spread, step = spread + step @ spread @ step.T, step @ step
    found = np.append(np.sqrt(np.diagonal(spread)), 1 / np.sqrt(abs(direct) + TINY))
    return np.where(np.isfinite(found) & (found > 0), found, 1.0)


def _grown(loop: LoopStates, count: int) -> Floats:
    """Return the growth of p^2/K in one sample, as a form in zeta and v_e."""
    assert loop.pull is not None
    size = len(loop.push) + 1
    return _stacked(tuple(tuple(loop.pull.grown(i, j) for j in range(size)) for i in range(size)), count)


def _stacked(matrix: Matrix, count: int) -> Floats:
    """Return a matrix whose entries are arrays as an array of matrices, shape (count, rows, columns)."""
    return np.array([[np.broadcast_to(np.asarray(x, float), count) for x in row] for row in matrix]).transpose(2, 0, 1)
