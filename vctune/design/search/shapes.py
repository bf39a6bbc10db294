"""Write a coupling as a scale times a shape. The least feasible scale has a closed form (README, section 3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import LoopsInHands
from vctune.design.search.samples import Samples
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.impedance_display import firmware_filter, offered_by_spring, spring_damper_admittance
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.worlds import WorldsMet
from vctune.running import check_time

SLACK = 1e-2  # Least time constant b_c/k_c of the scan, as a share of T


def unit_response(device: Device, omega: Floats, time_constant: Floats) -> tuple[Floats, Floats]:
    """Return u and v of the shape's response at omega."""
    if device.kind.inverse:
        theta = omega * device.sample_time
        low_pass = firmware_filter(device, theta, FLOATS)
        unit = spring_damper_admittance(SpringDamper(time_constant, 1.0), device.sample_time, low_pass, theta, FLOATS)
        return np.asarray(unit.re), np.asarray(unit.im)
    x2 = (omega * time_constant) ** 2
    return x2 / (1 + x2), np.where(time_constant > 0, np.sqrt(x2) / (1 + x2), omega)


def unit_at(device: Device, theta: Floats, time_constant: Floats) -> tuple[Floats, Floats]:
    """Return Re Z_c and sin(theta/2) cos(theta/2) Im Z_c of the sampled coupling for the scale 1, without drag."""
    rigid = bool(np.all(time_constant == 0))
    unit = Coupling(inf, 1.0, 0.0) if rigid else Coupling(1.0, time_constant, 0.0)
    at = offered_at(unit, device.sample_time, device.rule, theta, FLOATS)
    return np.asarray(at.resistance), np.asarray(np.sin(theta / 2) * at.reactance)


def scale_per_resistance(device: Device, place: Floats, time_constant: Floats) -> Floats:
    """Return the scale for the resistance 1: b_c with Re Z_c - b_0 = 1, or 1/k_c with Re(1/Z_c)/s^2 = 1."""
    if device.kind.inverse:
        low_pass = firmware_filter(device, place, FLOATS)
        unit = SpringDamper(time_constant, 1.0)
        there = np.asarray(offered_by_spring(unit, device.sample_time, low_pass, place, FLOATS).quotient)
        return np.where(
            there > 0, 1 / np.where(there > 0, there, 1.0), 1e100
        )  # with a slow filter, the damper may supply energy
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.where(time_constant > 0, place * time_constant, 0.0)
        return np.minimum(1 + 1 / x**2, 1e100)  # at 0 the series coupling has no resistance


def scale_limits(problem: Problem, time_constant: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest scale within the bounds, for each time constant."""
    bounds, tau = problem.bounds, time_constant
    if not problem.device.kind.inverse:
        if bounds.damping.min == inf:
            return bounds.mass.min + 0 * tau, bounds.mass.max + 0 * tau
        return np.maximum(bounds.damping.min, bounds.mass.min / tau), np.minimum(
            bounds.damping.max, bounds.mass.max / tau
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.where(tau > 0, tau / bounds.damping.max, 0.0)
        most = np.where(tau > 0, tau / bounds.damping.min, inf if bounds.damping.min == 0 else 0.0)
    return np.maximum(1 / bounds.stiffness.max, least), np.minimum(1 / bounds.stiffness.min, most)


def time_constants(problem: Problem, low: float, high: float) -> tuple[float, float]:
    """Return the least and the greatest time constant of the scan; they are equal if the time constant is fixed."""
    bounds = problem.bounds
    if problem.device.kind.inverse:
        above, below = bounds.damping, bounds.stiffness
        shortest = max(above.min / below.max, SLACK)
    else:
        above, below = bounds.mass, bounds.damping
        shortest = max(above.min / below.max, 1e-2 / high * min(1.0, 1 / below.min))
    if above.max == 0 or below.min == inf:
        return 0.0, 0.0
    if above.fixed and below.fixed:
        return above.min / below.min, above.min / below.min
    return shortest, max(shortest, min(above.max / below.min, 1e2 / low))


def coupling_of(problem: Problem, scale: float, time_constant: float, drag: float) -> AnyCoupling:
    """Return the coupling with a given scale and shape, within the bounds."""
    bounds = problem.bounds

    def clipped(name: str, value: float) -> float:
        range_ = getattr(bounds, name)
        return float(np.clip(value, range_.min, range_.max))

    if problem.device.kind.inverse:
        return SpringDamper(clipped("damping", time_constant / scale), clipped("stiffness", 1 / scale))
    mass = scale if bounds.damping.min == inf else scale * time_constant
    return Coupling(clipped("damping", scale), clipped("mass", mass), float(drag))


def scaled_coupling(coupling: AnyCoupling, by: float) -> AnyCoupling:
    """Return a coupling of the same shape with Z_c times a factor or, for an impedance display, with 1/Z_c times a
    factor."""
    if isinstance(coupling, SpringDamper):
        return SpringDamper(coupling.damping / by, coupling.stiffness / by)
    return replace(coupling, damping=coupling.damping * by, mass=coupling.mass * by, drag=coupling.drag * by)


MOST = 1e100  # Number that replaces infinity in products
LEAPS = 2  # Number of passes over the forbidden intervals


@np.errstate(divide="ignore", invalid="ignore")
def least_scale_in_worlds(
    met: WorldsMet, samples: Samples, gains: Gains, time_constant: Floats, drags: Floats
) -> Floats:
    """Return an estimate of the least b_c that no environment of a box forbids."""
    rows = [_forbidding(met, samples.device.sample_time, there, gains) for there in _places(samples)]
    theta, missing, stiff, soft = (np.concatenate(parts, axis=-1) for parts in zip(*rows, strict=True))
    asked = (missing > 0).any(axis=tuple(range(missing.ndim - 1)))
    theta, missing, stiff, soft = theta[asked], missing[..., asked], stiff[..., asked], soft[..., asked]
    scale = np.empty((*missing.shape[:-1], time_constant.shape[-1], drags.shape[-1]))
    for i in range(time_constant.shape[-1]):
        tau = time_constant[..., i, None, None, None]
        resistance, reactance = unit_at(samples.device, theta, tau)
        first, last = stiff / reactance, soft / reactance
        for k in range(drags.shape[-1]):
            check_time()
            drag = drags[..., k, None, None, None]
            enough = np.minimum(np.where(missing > drag, (missing - drag) / resistance, 0.0), last)
            left = np.zeros(missing.shape[:-1])
            for _ in range(LEAPS):
                left = np.fmax(left, np.where(first <= left[..., None], enough, 0.0).max(axis=-1, initial=0.0))
            scale[..., i, k] = np.minimum(left, MOST)
    return scale


def _times(limit: float, number: Floats) -> Floats:
    """Return a limit times a number >= 0; without a limit the product is infinite, even if the number is 0."""
    return limit * number if limit < inf else np.full_like(number, inf)


def _places(samples: Samples) -> Iterator[LoopsInHands]:
    for there in samples.everywhere:
        yield from (held for held in there.in_hand if isinstance(held, LoopsInHands))


def _forbidding(
    met: WorldsMet, sample_time: float, held: LoopsInHands, gains: Gains
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return angles, and the limits of the forbidden region at each angle."""
    worlds, factor, half = met.worlds, met.factor, held.theta / 2
    inertia, compliance = 2 / sample_time * np.sin(half) ** 2, sample_time / 2 * np.cos(half) ** 2
    seen = held.seen(Gains(gains.velocity[..., None, None], gains.position[..., None, None]))
    swing, R = seen.swing * np.cos(half) / seen.size, seen.lost / seen.size
    stiff = swing - _times(worlds.high.mass, inertia) + worlds.low.stiffness * compliance
    soft = factor * (swing - worlds.low.mass * inertia + _times(worlds.high.stiffness, compliance))
    missing = factor * (R - worlds.low.damping)
    each = ((missing, 0.0), (stiff, -MOST), (soft, MOST))
    known = (np.nan_to_num(number, nan=unknown, posinf=MOST, neginf=-MOST) for number, unknown in each)
    found = (number.reshape(*number.shape[:-2], -1) for number in known)
    return np.tile(held.theta, held.hands.mass.size), *found
