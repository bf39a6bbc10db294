"""Find a candidate for a storage function that serves all dampings of a hand. The search runs in floats, and rounds its
result to decimals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.matrices import Matrix
from vctune.model.sampled.changing.loop_states import Law, LoopStates, loop_states
from vctune.model.sampled.changing.storage_function import TERMS, Storage, moved_mass, weights
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.array_intervals import TINY, Flags, Floats
from vctune.proof.storage.barrier import Family, analytic_centre

ACROSS = {"mass": 4, "damping": 3, "stiffness": 3}
"""Number of values of each quantity in the grid of hands for the first candidate. With one value less, many designs
need another round; with one more, the search takes a third longer."""
DIGITS = 14
"""Significant digits of the decimals. Half as many are too few for loops with a small margin; twice as many exceed the
digits of a double."""


DOUBLINGS = 60
"""Number of doublings of the time over which noise drives the states: 2^60 samples, after which the states of every
stable loop are stationary."""


@dataclass(frozen=True, slots=True)
class Places:
    """Hands for which the search needs a storage function, each with a sensed damping; arrays of shape (p,).

    Attributes
    ----------
    hand : the hand from this sample on
    sensed : damping of the hand when the sensor sampled the force; the least or the greatest, because the inequality is
        affine in it
    """

    hand: Hand
    sensed: Floats

    def with_hand(self, hand: Hand, hands: Hands) -> Places:
        """Return these hands and one more, both with the least and with the greatest sensed damping.

        Parameters
        ----------
        hand : another hand
        hands : the box
        """
        ends = np.array([hands.low.damping, hands.high.damping])
        more = hand.mapped(lambda number: np.full(2, number))
        joined = self.hand.mapped(lambda one, other: np.concatenate([one, other]), more)
        return Places(joined, np.concatenate([self.sensed, ends]))


def grid(hands: Hands) -> Places:
    """Return a grid of hands over the whole box."""
    ends = hands.ranges
    axes = [
        np.linspace(*ends[name], ACROSS[name]) if ends[name][0] < ends[name][1] else ends[name][:1] for name in ends
    ]
    sensed = np.unique([hands.low.damping, hands.high.damping])
    *numbers, last = (each.ravel() for each in np.meshgrid(*axes, sensed, indexing="ij"))
    return Places(Hand(*numbers), last)


def candidate(design: Design, hands: Hands, at: Places) -> Storage | None:
    """Return a storage that grows by at most what the port supplies in the given hands; None if the search finds none.

    Parameters
    ----------
    design : design in plain numbers
    hands : box of hands to which the storage's weights refer
    at : hands of the box
    """
    sought = _affine(design, hands, at)
    found = analytic_centre(sought.constant, sought.families, sought.free)
    if found is None:
        return None
    terms = np.tensordot(found, sought.basis, axes=1)
    return Storage(hands, tuple(tuple(tuple(_rounded(x) for x in row) for row in term) for term in terms.tolist()))


def hand_without(design: Design, hands: Hands) -> Hand | None:
    """Return a corner of the masses and stiffnesses for which the search finds no storage for all dampings.

    Parameters
    ----------
    design : design in plain numbers
    hands : the box of hands

    Returns
    -------
    Hand or None
        A corner, with the greatest damping; None if each corner has a storage. The function tries no hand between
            corners.
    """
    for corner in hands.corners:
        if corner.damping < hands.high.damping:
            continue
        fixed = Hands(Hand(corner.mass, hands.low.damping, corner.stiffness), corner)
        if candidate(design, fixed, grid(fixed)) is None:
            return corner
    return None


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")


class _Sought(NamedTuple):
    """The matrices of `room_of_storage` as affine functions of coefficients.

    Attributes
    ----------
    constant, families, free : see `analytic_centre`
    basis : matrices whose combinations are all symmetric Y, one for each entry of a triangle
    """

    constant: Floats
    families: tuple[Family, ...]
    free: Flags
    basis: Floats


def _affine(design: Design, hands: Hands, at: Places) -> _Sought:
    """Return the inequality in each hand as a matrix that is affine in the entries of Y (model/README.md, section 21).

    Y^- belongs to the damping when the sensor sampled the force, and Y to the damping from then on. Both are weighted
    sums of the same terms U. Y^- - F'YF is therefore the sum of weights_before (U - F'UF) + (weights_before -
    weights_after) F'UF over the terms.
    """
    plain, count = (design.device, Law(design.gains, design.series)), at.sensed.size
    loop = loop_states(plain, plain, at.hand, at.sensed, FLOATS)
    n = len(loop.push)
    moved = _stacked(tuple((*row, push) for row, push in zip(loop.change, loop.push, strict=True)), count)
    before = replace(at.hand, damping=at.sensed)
    weights_before, weights_after = (
        _stacked((weights(hands, moved_mass(design.device), hand, float),), count)[:, 0] for hand in (before, at.hand)
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
    after, free = held - kept, np.ones((len(TERMS), rows.size), bool)
    if loop.pull is not None:
        kept[:, 0], after[:, 0] = -_grown(loop, count) * basis[0, 0, 0], 0.0
        free[TERMS.index("beta"), 0] = False
    across = np.outer(unit, unit)
    return _Sought(
        constant * across,
        (Family(weights_before, kept * across), Family(weights_before - weights_after, after * across)),
        free,
        basis,
    )


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
