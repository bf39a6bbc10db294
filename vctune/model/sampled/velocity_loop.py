"""Evaluate the exact sampled velocity loop, with any real delay (model/README.md, sections 7 and 12)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.drive import drive_states
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.state_space import StepResponse, sampled_states

Polynomial = tuple[Number, ...]  # Coefficients c_k of d^k w^(n-k), lowest power of d first


@dataclass(frozen=True, slots=True)
class SampledPlant:
    """The exact sampled model of a device with input delay, for a held input."""

    open: Polynomial  # O, of degree n, without its last coefficient, which is 1
    velocity: tuple[Polynomial, Polynomial]
    position: tuple[Polynomial, Polynomial]  # P for the newer and the older force, m/N
    whole_samples: Number  # N, the number of whole samples in the delay
    fractional: bool  # whether delta > 0, so that an older force acts
    low_pass: Number | None = None  # a of the firmware's low-passes; None without low-passes
    order: int = 0  # r, the number of low-passes

    def converted(self, number: Callable[[Number], Number]) -> SampledPlant:
        """Return the plant with its numbers in another arithmetic."""

        def each(polynomial: Polynomial) -> Polynomial:
            return tuple(number(c) for c in polynomial)

        def taps(newer: Polynomial, older: Polynomial) -> tuple[Polynomial, Polynomial]:
            return each(newer), each(older) if self.fractional else older

        low_pass = None if self.low_pass is None else number(self.low_pass)
        return replace(
            self,
            open=each(self.open),
            velocity=taps(*self.velocity),
            position=taps(*self.position),
            low_pass=low_pass,
        )


# Difference from a whole number of samples, as a share of a sample, that the code treats as a rounding error
SNAP = 1e-12


def split_delay(delay: Number, sample_time: Number) -> tuple[Number, Number]:
    """Split a delay into whole samples and the remaining fraction of a sample."""
    if np.ndim(delay) > 0:
        split = [split_delay(float(one), sample_time) for one in delay]
        return np.array([whole for whole, _ in split]), np.array([fraction for _, fraction in split])
    samples = delay / sample_time
    nearest = round(samples)
    if abs(samples - nearest) <= SNAP * max(1.0, samples):
        return nearest, 0.0
    return floor(samples), samples - floor(samples)


def sampled_plant(device: Device, whole_samples: Number, ops: Arithmetic, *, fractional: bool) -> SampledPlant:
    """Sample a device without a hand exactly (model/README.md, sections 7 and 12)."""
    T = device.sample_time
    older = device.delay - whole_samples * T if fractional else None
    if not drive_states(device) and device.structure is None:
        response = _rigid(device, older, ops)
    else:
        response = _in_si(sampled_states(device, older, ops), device)
    plant = SampledPlant(response.open, response.velocity, response.position, whole_samples, fractional)
    estimate = device.velocity
    if estimate is None:
        return plant
    if estimate.source == "difference":
        newer, older_force = plant.position
        velocity = tuple(c / T for c in newer), tuple(c / T for c in older_force)
        plant = replace(plant, velocity=velocity)
    if estimate.filter_hz is None:
        return plant
    a, _ = low_pass_coefficients(estimate.filter_hz, T, ops)
    return replace(plant, low_pass=a, order=estimate.filter_order)


def _rigid(device: Device, older: Number | None, ops: Arithmetic) -> StepResponse:
    """Sample 1/(m s + b) in closed form. A separate formula for 1 - e^{-bT/m} avoids cancellation."""
    m, T = device.mass, device.sample_time
    rate = device.damping / m

    def velocity_step(t: Number) -> Number:
        return t / m * ops.phi_1(rate * t)

    def position_step(t: Number) -> Number:
        return t * t / m * ops.phi_2(rate * t)

    t_0 = T if older is None else T - older
    drift = T * ops.phi_1(rate * T)  # distance that the device coasts in one sample if it starts with unit velocity
    fall = rate * drift
    beta_0, gamma_0 = velocity_step(t_0), position_step(t_0)
    beta_1 = gamma_1 = 0
    if older is not None:
        v_1 = velocity_step(older)  # the velocity that the older force caused coasts on for t_0
        beta_1 = v_1 * ops.exp(-(rate * t_0))
        gamma_1 = position_step(older) + v_1 * (t_0 * ops.phi_1(rate * t_0))
    return StepResponse(
        open=(fall,),
        velocity=((beta_0,), (beta_1,)),
        position=((drift * beta_0 + gamma_0 * fall, gamma_0), (drift * beta_1 + gamma_1 * fall, gamma_1)),
    )


def _in_si(response: StepResponse, device: Device) -> StepResponse:
    """Return a dimensionless response with its velocities and positions in m/s and m per newton."""
    velocity = device.sample_time / device.mass
    position = velocity * device.sample_time

    def both(taps: tuple[Polynomial, Polynomial], unit: Number) -> tuple[Polynomial, Polynomial]:
        newer, older = (tuple(c * unit for c in tap) for tap in taps)
        return newer, older

    return StepResponse(response.open, both(response.velocity, velocity), both(response.position, position))


@dataclass(frozen=True, slots=True)
class ReturnDifference:
    """F = open + K_v velocity + K_p position, dimensionless, at one or several points of the unit circle."""

    open: Pair
    velocity: Pair
    position: Pair

    def closed(self, gains: Gains) -> Pair:
        """Return F for the given gains."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)


def return_difference(plant: SampledPlant, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of the return difference F at z = e^{j theta} (model/README.md, section 7)."""
    sin = ops.sin(theta)
    half_sine = ops.sin(theta / 2)  # the form 2 sin^2(theta/2) of 1 - cos theta does not cancel
    d, w = Pair(2 * half_sine * half_sine, sin), Pair(ops.cos(theta), -sin)

    def delayed(steps: Number) -> Pair:
        if isinstance(steps, int) and steps == 1:
            return w
        return Pair(ops.cos(theta * steps), -ops.sin(theta * steps))

    newer = delayed(plant.whole_samples + 1)
    older = delayed(plant.whole_samples + 2) if plant.fractional else None

    def input_path(taps: tuple[Polynomial, Polynomial]) -> Pair:
        path = _homogeneous(taps[0], d, w, newer)
        return path if older is None else path + _homogeneous(taps[1], d, w, older)

    open_loop, velocity = _monic(plant.open, d, w), input_path(plant.velocity)
    low_pass = None
    if plant.low_pass is not None:
        once = _monic((plant.low_pass,), d, w)
        gain = plant.low_pass if plant.order == 1 else plant.low_pass * plant.low_pass
        low_pass, velocity = once if plant.order == 1 else once * once, velocity.scaled(gain)
        open_loop = open_loop * low_pass
    if not position:
        return ReturnDifference(open_loop, velocity, Pair(0, 0))
    travel = input_path(plant.position)
    return ReturnDifference(open_loop * d, velocity * d, travel if low_pass is None else travel * low_pass)


def _homogeneous(coefficients: Polynomial, d: Pair, w: Pair, delay: Pair) -> Pair:
    """Return the sum of c_k d^k w^(n - 1 - k) over the n coefficients, k < n, times a delay."""
    *lower, last = coefficients
    total, power = None, w
    for c in reversed(lower):
        total = (d.scaled(last) if total is None else total * d) + power.scaled(c)
        power = power * w
    return delay.scaled(last) if total is None else total * delay


def _monic(coefficients: Polynomial, d: Pair, w: Pair) -> Pair:
    """Return d^n plus the sum of c_k d^k w^(n - k) over the n coefficients, k < n."""
    *lower, last = coefficients
    rest = 1 - last
    total, power = Pair(last + rest * d.re, rest * d.im), w  # d + last w with w = 1 - d; theta appears once
    for c in reversed(lower):
        power = power * w
        total = total * d + power.scaled(c)
    return total


def sensitivity_abs2(parts: ReturnDifference, gains: Gains) -> Number:
    """Return |S|^2 = |F_0/F|^2 of the sampled loop, where F_0 is the return difference with both gains 0."""
    return parts.open.abs2() / parts.closed(gains).abs2()


def difference_slope(theta: Number, ops: Arithmetic) -> Pair:
    """Return (1 - e^{-j theta})/theta, regular at theta = 0."""
    half = theta / 2
    return Pair(ops.sin(half) * ops.sinc(half), ops.sinc(theta))
