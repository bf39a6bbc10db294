"""A servo whose response is known up to a disc, before nothing or a box: its limit by a sum over its own aliases."""

from __future__ import annotations

import itertools
from math import inf, pi

import numpy as np
import pytest

from vctune import check

NAMES = ("mass", "damping", "stiffness")
ALIASES = 2 * pi * np.arange(-600, 601)[:, None]


def drawn(rng):
    """Return a servo behind a low-pass sensor, the greatest hand, and the points of a disc."""
    T = float(f"{10 ** rng.uniform(-3, -2.1):.4g}")
    delay, bandwidth = T * (rng.integers(0, 12) + rng.uniform(0.1, 0.9)), 10 ** rng.uniform(-1.7, -0.8) / T
    servo = {"delay": float(delay), "bandwidth_hz": float(bandwidth), "order": int(rng.integers(1, 3))}
    sensor = {"bandwidth_hz": float(10 ** rng.uniform(-1.2, -0.4) / T), "order": 2}
    most = np.array([rng.choice([0, 0.5, 2]), rng.choice([0, 30.0]), 10 ** rng.uniform(2, 3.7)])
    disc = [[0.002 / T, float(10 ** rng.uniform(-3, -1.3))], [0.45 / T, float(10 ** rng.uniform(-2, -0.5))]]
    return {"sample_time": T, "servo": servo, "force_sensor": sensor}, most, disc


def low_pass(s, hz, order):
    w = 2 * pi * hz
    return w / (s + w) if order == 1 else w**2 / (s * s + 2**0.5 * w * s + w**2)


def seen(device, hand, omega):
    """Return the sensed force over the held command: the sum over the aliases of the responses in continuous time."""
    T, (M, B, K), servo, sensor = device["sample_time"], hand, device["servo"], device["force_sensor"]
    s = 1j * (omega + ALIASES / T)
    moved = low_pass(s, servo["bandwidth_hz"], servo["order"]) * np.exp(-s * servo["delay"]) * (1 - np.exp(-s * T))
    return ((M * s + B + K / s) * moved * low_pass(s, sensor["bandwidth_hz"], 2) / (s * T)).sum(axis=0)


def greatest_failing(device, most, disc, tau):
    """Return the greatest y with y (1 + tau s_d) + Z_seen within the disc's radius of what dampers take."""
    T = device["sample_time"]
    omega = np.geomspace(1e-4, pi, 3000) / T
    (f, g), (r, q) = np.array(disc).T
    share = r * (omega / (2 * pi * f)) ** (np.log(q / r) / np.log(g / f))
    share = np.where(omega < 2 * pi * f, r * omega / (2 * pi * f), np.where(omega > 2 * pi * g, q, share))
    c, top = 1 + tau * 2j / T * np.tan(omega * T / 2), 0.0
    for shares in itertools.product((0, 0.1, 0.3, 1), (0, 1), (0, 0.03, 0.1, 0.3, 1)):
        Z = seen(device, tuple(shares * most), omega)
        radius = share * np.abs(Z)
        beside = np.maximum((-Z.imag - radius) / c.imag, 0)
        within = np.minimum((radius - Z.imag) / c.imag, -Z.real / c.real)
        along, size = (c.conj() * Z).real, np.abs(c) ** 2
        root = along**2 - size * (np.abs(Z) ** 2 - radius**2)
        in_disc = (np.sqrt(np.maximum(root, 0)) - along) / size
        top = max([top, *within[beside <= within], *in_disc[(root >= 0) & (in_disc > 0)]])
    return top


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_a_disc_before_nothing_is_decided_next_to_its_limit(seed):
    rng = np.random.default_rng((77, seed))
    device, most, disc = drawn(rng)
    tau = (device["servo"]["delay"] + device["sample_time"]) * 10 ** rng.uniform(0, 1)
    limit = greatest_failing(device, most, disc, tau)
    hands = {name: {"min": 0.0, "max": float(x)} for name, x in zip(NAMES, most, strict=True)}
    stated = {"device": device, "operator": hands, "uncertainty": {"unmodelled": disc}}
    stated |= {"environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}, "stability": {"safety_factor": 1.0}}
    for by, verdict in ((1.005, "passed"), (0.995, "failed")):
        law = {"damping": inf, "mass": float(by * limit * tau), "drag": float(by * limit)}
        assert check(stated | {"coupling": law}).result == verdict


@pytest.mark.slow
def test_with_a_safety_factor_every_share_of_the_coupling_holds():
    """What passes with the factor passes without it when the coupling is divided by any number up to it."""
    rng = np.random.default_rng(5)
    device, most, disc = drawn(rng)
    hands = {name: {"min": 0.0, "max": float(x)} for name, x in zip(NAMES, most, strict=True)}
    stated = {"device": device, "operator": hands, "uncertainty": {"unmodelled": disc}}
    stated |= {"environment": {"mass": {"max": 0.5}, "stiffness": {"max": 500.0}}}
    tau = device["servo"]["delay"] + device["sample_time"]
    drag = next(
        float(drag)
        for drag in np.geomspace(1, 1e5, 60)
        if check(
            stated
            | {"coupling": {"damping": inf, "mass": drag * tau, "drag": drag}, "stability": {"safety_factor": 1.5}}
        ).result
        == "passed"
    )
    for share in (1.0, 1.2, 1.5):
        law = {"damping": inf, "mass": drag * tau / share, "drag": drag / share}
        assert check(stated | {"coupling": law, "stability": {"safety_factor": 1.0}}).result == "passed"
