"""Boxes next to rest, without an integrator: those with a share of stiffness that no hand has there are left out."""

from __future__ import annotations

import numpy as np
import pytest

from vctune.model.device import Device
from vctune.model.hands import HAND
from vctune.proof.claims.array_claims import SHARES
from vctune.proof.claims.in_hands.own_share import with_own_share
from vctune.proof.engine.boxes import FREQUENCY, Boxes
from vctune.proof.engine.branching import Decided

NAMES = (*HAND, *SHARES, "device.mass")
T = 1e-3


def undecided(boxes):
    none, zero = np.zeros(len(boxes), bool), np.zeros_like(boxes.low)
    return Decided(none, none, boxes.low, zero, none, zero, np.zeros(len(boxes)))


def left_out(names, low, high):
    none = np.zeros(low.shape[1], np.intp)
    boxes = Boxes((FREQUENCY, *names), low, high, owner=none, whole_samples=none)
    return with_own_share(undecided, Device(0.4, 2.0, T), names)(boxes).proved


def own_share(theta, stiffness, mass):
    spring = stiffness * T * T / mass
    with np.errstate(invalid="ignore"):
        return spring / (2 * np.sin(theta / 2) + spring)


@pytest.mark.parametrize("uncertain", [False, True])
def test_a_box_is_left_out_where_it_has_no_share_of_its_own_hands_and_angles(uncertain):
    rng, count, names = np.random.default_rng(9), 4000, NAMES if uncertain else NAMES[:-1]
    rows = [10.0 ** rng.uniform(-9, 0, count), *rng.uniform(0, 1, (2, count)), 10.0 ** rng.uniform(-9, 3, count)]
    rows += [np.zeros(count), rng.uniform(0, 1, count)] + ([rng.uniform(0.2, 0.6, count)] if uncertain else [])
    low = np.array(rows)
    low[0, ::5], low[3, ::7] = 0.0, 0.0
    high = low * 10.0 ** rng.uniform(0, 2, low.shape) + 1e-12 * (low == 0)
    high[0] = np.minimum(high[0], np.pi)
    high[5] = np.minimum(low[5] + rng.uniform(0, 0.2, count), 1.0)
    out = left_out(names, low, high)
    assert 0.1 < out.mean() < 0.9
    for _ in range(200):  # no point of a box that is left out has its own share in it
        at = low + rng.choice([0.0, 1.0, rng.uniform()], low.shape) * (high - low)
        share = own_share(at[0], at[3], at[-1] if uncertain else 0.4)
        assert not np.any(out & (low[5] <= share) & (share <= high[5]))


def test_at_rest_in_a_hand_without_stiffness_every_share_is_looked_at():
    low = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [0.7]])
    high = np.array([[1e-9], [0.5], [30.0], [1e-9], [0.0], [0.8]])
    assert not left_out(NAMES[:-1], low, high).any()
    low[0] = 1e-3
    high[0] = 2e-3
    assert left_out(NAMES[:-1], low, high).all()
