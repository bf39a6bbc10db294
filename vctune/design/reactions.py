"""Find the environments that put a pole of the loop on the unit circle: a curve for each hand, in double precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, pi
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.model.coupling import coupling_impedance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.running import check_time

Numbers = NDArray[np.intp]
Marks = NDArray[np.bool_]

# Positions in the range of each parameter of a hand at which the search evaluates hands: 0 is the least value, 1 the
# greatest
SHARES = (0.0, 0.001, 0.01, 0.04, 0.1, 0.2, 0.4, 0.7, 1.0)
INWARDS = 1e-9  # Relative distance of the least evaluated share of the coupling from the end 1/g of its range
LOWEST, NEAR = 1e-4, 1e-3  # Least angle theta, and distance of the greatest angle from pi, rad
# Number of angles of the first grid, and number of angles of the fine grid where some environment puts a pole
COARSE, FINE = 160, 400


@dataclass(frozen=True, slots=True)
class Reactions:
    """The environments that put a pole on the unit circle, as curves with the angle as parameter."""

    theta: Floats  # omega T, rad, and (2/T) tan(theta/2), rad/s, shape (n,)
    u: Floats
    device: Floats  # index of the device for each curve, shape (curves,)
    hands: Hand  # hand of each curve, with parameters of shape (curves,)
    share: Floats  # share of the coupling for each curve
    damping: Floats  # damping and reactance of the environment, N s/m, shape (curves, n)
    reactance: Floats

    def curves(self, at: Numbers) -> Reactions:
        """Return the curves with the given indices."""
        hands = self.hands.mapped(itemgetter(at))
        return Reactions(
            self.theta, self.u, self.device[at], hands, self.share[at], self.damping[at], self.reactance[at]
        )


def reactions(
    devices: Sequence[Device],
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    factor: float,
    shares: tuple[float, ...] = SHARES,
) -> Reactions:
    """Return the outermost curves, at the angles where an environment with damping >= 0 puts a pole."""
    theta = np.geomspace(LOWEST, pi - NEAR, COARSE)
    coarse = _over(devices, hands, gains, coupling, factor, shares, theta)
    with_pole = np.any(coarse.damping >= 0, axis=0)
    if not with_pole.any():
        return coarse.curves(np.zeros(0, np.intp))
    outermost = coarse.curves(_farthest(coarse))
    wide = with_pole | np.append(with_pole[1:], False) | np.append(False, with_pole[:-1])
    near = np.interp(np.linspace(0, wide.sum() - 1, FINE), np.arange(wide.sum()), np.log(theta[wide]))
    fine = np.unique(np.append(np.exp(near), theta[wide]))
    return _along(devices, outermost, gains, coupling, fine)


def _farthest(curves: Reactions) -> Numbers:
    """Return the indices of the curves that have, at some angle, the greatest damping or the greatest or least
    reactance."""
    with_pole = curves.damping >= 0
    outwards = [
        np.where(with_pole, curves.damping, -np.inf),
        np.where(with_pole, curves.reactance, -np.inf),
        np.where(with_pole, -curves.reactance, -np.inf),
    ]
    best = np.concatenate([np.argmax(values, axis=0)[with_pole.any(axis=0)] for values in outwards])
    return np.unique(best)


def _over(
    devices: Sequence[Device],
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    factor: float,
    shares: tuple[float, ...],
    theta: Floats,
) -> Reactions:
    places = [np.unique(np.minimum(low + (high - low) * np.array(shares), high)) for low, high in hands.ranges.values()]
    of_coupling = np.unique((1.0, 0.5 * (1 + 1 / factor), min(1.0, (1 + INWARDS) / factor)))
    every = np.array(list(product(range(len(devices)), of_coupling, *places))).T
    each = Hand(**dict(zip(hands.ranges, every[2:], strict=True)))
    start = Reactions(theta, theta, every[0], each, every[1], theta, theta)
    return _along(devices, start, gains, coupling, theta)


@np.errstate(all="ignore")
def _along(
    devices: Sequence[Device], curves: Reactions, gains: Gains, coupling: AnyCoupling, theta: Floats
) -> Reactions:
    """Return curves of the same devices, hands and shares of the coupling at other angles."""
    environment = np.empty((curves.share.size, theta.size), complex)
    for k in np.unique(curves.device).astype(int):
        check_time()
        device, at = devices[k], np.flatnonzero(curves.device == k)
        hand = curves.hands.mapped(itemgetter(at[:, None]))
        seen = seen_in_hand(loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS), gains)
        s, share, T = np.sin(theta / 2), curves.share[at, None], device.sample_time
        reaction = -(seen.lost / seen.size) - 1j * seen.swing / (s * seen.size)
        if isinstance(coupling, SpringDamper):
            admittance = spring_damper_admittance(coupling, T, firmware_filter(device, theta, FLOATS), theta, FLOATS)
            environment[at] = -1 / (share * (admittance.re + 1j * admittance.im) + s * s * reaction)
        else:
            Z_c = coupling_impedance(series_coupling(coupling), 2 / T * np.tan(theta / 2))
            environment[at] = -(share * (Z_c.re + 1j * Z_c.im) + reaction)
    u = 2 / devices[0].sample_time * np.tan(theta / 2)
    damping = np.where(np.isfinite(environment), environment.real, -np.inf)
    return Reactions(theta, u, curves.device, curves.hands, curves.share, damping, np.nan_to_num(environment.imag))


@dataclass(frozen=True, slots=True)
class LimitPoints:
    """The points of curves whose damping exceeds a limit, in runs of neighbouring angles on one curve."""

    curve: Numbers  # indices of the curve and of the angle, shape (n,)
    angle: Numbers
    u: Floats  # (2/T) tan(theta/2), rad/s, and the environment's damping and reactance, N s/m
    damping: Floats
    reactance: Floats
    starts: Numbers  # indices of the points at which a new run begins

    @classmethod
    def of(cls, curves: Reactions, least: float) -> LimitPoints:
        """Return the points whose damping exceeds a limit."""
        curve, angle = np.nonzero(curves.damping > least)
        new = np.ones(curve.size, bool)
        new[1:] = (np.diff(curve) != 0) | (np.diff(angle) != 1)
        damping, reactance = curves.damping[curve, angle], curves.reactance[curve, angle]
        return cls(curve, angle, curves.u[angle], damping, reactance, np.flatnonzero(new))

    @classmethod
    def with_edges(cls, curves: Reactions, least: float) -> LimitPoints:
        """Return the points of `of`, and the points between two angles where the damping of a curve equals the
        limit."""
        points, exceeds = cls.of(curves, least), curves.damping > least
        curve, angle = np.nonzero(exceeds[:, 1:] != exceeds[:, :-1])
        first, last = curves.damping[curve, angle], curves.damping[curve, angle + 1]
        with np.errstate(all="ignore"):
            share = np.nan_to_num((least - first) / (last - first))

        def at_edge(values: Floats) -> Floats:
            return np.asarray(values[..., 0] + share * (values[..., 1] - values[..., 0]))

        beside = np.stack((angle, angle + 1), axis=1)
        edge_values = (
            at_edge(curves.u[beside]),
            np.full(curve.size, least),
            at_edge(curves.reactance[curve[:, None], beside]),
        )
        point_values = points.u, points.damping, points.reactance
        u, damping, reactance = (np.append(old, new) for old, new in zip(point_values, edge_values, strict=True))
        runs = points.curve.size + np.arange(curve.size)
        return cls(
            np.append(points.curve, curve),
            np.append(points.angle, angle),
            u,
            damping,
            reactance,
            np.append(points.starts, runs),
        )

    def hit(self, low: Floats, high: Floats) -> Marks:
        """Return a flag for each box of environments: whether it contains an environment with a pole at one of the
        points."""
        least, most = self._reactances(low, high)
        enough = self.damping >= low[1][:, None]
        return np.any(enough & (self.reactance >= least) & (self.reactance <= most), axis=1)

    def between(self, low: Floats, high: Floats) -> list[tuple[int, int, int] | None]:
        """Return for each box a curve and two of its angles between which every environment of the box has a pole; None
        if there are none."""
        if not self.starts.size:
            return [None] * low.shape[1]
        below, above = self._reactances(low, high)
        over, under = self.reactance > above, self.reactance < below
        both = np.logical_or.reduceat(over, self.starts, axis=1) & np.logical_or.reduceat(under, self.starts, axis=1)
        runs = np.column_stack((self.starts, np.append(self.starts[1:], self.curve.size)))
        return [self._nearest(over[cell], under[cell], runs[both[cell]].tolist()) for cell in range(low.shape[1])]

    def _nearest(self, over: Marks, under: Marks, runs: Sequence[Sequence[int]]) -> tuple[int, int, int] | None:
        """Return the curve and the angles of two points of a run on opposite sides of a box; None if there are none."""
        best, found = -inf, None
        for start, end in runs:
            flagged = start + np.flatnonzero(over[start:end] | under[start:end])
            for k in np.flatnonzero(over[flagged[:-1]] != over[flagged[1:]]):
                first, last = flagged[k], flagged[k + 1]
                least = float(self.damping[first : last + 1].min())
                if least > best:
                    best, found = least, (int(self.curve[first]), int(self.angle[first]), int(self.angle[last]))
        return found

    def stiffest(self, low: Floats, high: Floats) -> float:
        """Return the greatest stiffness up to which no environment of a box has a pole; inf if there is no limit."""
        with_pole = (self.damping >= low[1]) & (self.reactance <= high[0] * self.u - low[2] / self.u)
        return float(np.min((low[0] * self.u - self.reactance)[with_pole] * self.u[with_pole], initial=inf))

    def lightest(self, low: Floats, high: Floats) -> float:
        """Return the least mass above which no environment of a box has a pole."""
        with_pole = (self.damping >= low[1]) & (self.reactance <= high[0] * self.u - low[2] / self.u)
        return float(np.max((self.reactance + high[2] / self.u)[with_pole] / self.u[with_pole], initial=0.0))

    def _reactances(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return the least and the greatest reactance of boxes at the points, shape (boxes, n)."""
        least = low[0][:, None] * self.u - high[2][:, None] / self.u
        return least, high[0][:, None] * self.u - low[2][:, None] / self.u
