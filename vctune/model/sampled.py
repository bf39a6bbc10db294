"""The sampled velocity loop: plant 1/(m s + b) sampled exactly, any real delay (model/README.md, section 7).

Between samples the plant sees u[k-N-1] for the first delta T and u[k-N] for the rest, where
delay = (N + delta) T. With z = e^{j theta} the loop's return difference is

    F(z) = (1 - a/z)(1 - 1/z) + K_v z^-1 B (1 - 1/z) + K_p z^-2 (m phi B + G (z - a)),
    B = beta_0 z^-N + beta_1 z^-(N+1),   G = gamma_0 z^-N + gamma_1 z^-(N+1),

or F = (1 - a/z) + K_v z^-1 B when K_p = 0: the position is then not in the loop. With F_0 the part without gains the
loop's sensitivity is S = F_0/F = 1/(1 + K_v G_v + K_p G_x), G_v and G_x being the pulse transfer functions from the
held force to velocity and position; they are affine in the gains with complex constants that only the device knows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor

import numpy as np

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.pair import Pair
from vctune.model.quantities import Device, Gains


@dataclass(frozen=True, slots=True)
class SampledPlant:
    """The step-invariant plant with input delay.

    Attributes
    ----------
    pole : a = e^{-bT/m}
    slack : 1 - a, by its own formula
    drift : m phi(T), how far a unit velocity coasts in one sample, s
    velocity : beta_0, beta_1: velocity after one sample per unit held force, m/(N s)
    position : gamma_0, gamma_1: position after one sample per unit held force, m/N
    whole : N, whole samples of delay
    fractional : whether delta > 0, that is, whether beta_1 and gamma_1 are there at all
    """

    pole: Number
    slack: Number
    drift: Number
    velocity: tuple[Number, Number]
    position: tuple[Number, Number]
    whole: Number
    fractional: bool

    def over(self, number: Callable[[Number], Number]) -> SampledPlant:
        """Return the plant in numbers of another arithmetic."""
        (beta_0, beta_1), (gamma_0, gamma_1) = self.velocity, self.position
        late = (number(beta_1), number(gamma_1)) if self.fractional else (beta_1, gamma_1)
        return SampledPlant(
            number(self.pole),
            number(self.slack),
            number(self.drift),
            (number(beta_0), late[0]),
            (number(gamma_0), late[1]),
            self.whole,
            self.fractional,
        )


def whole_samples(delay: Number, sample_time: Number) -> tuple[Number, Number]:
    """Split a delay, or an array of them, into whole samples and the fraction of one that remains.

    What differs from a whole sample by rounding noise counts as one.
    """
    if np.ndim(delay) > 0:
        split = [whole_samples(float(one), sample_time) for one in delay]
        return np.array([whole for whole, _ in split]), np.array([fraction for _, fraction in split])
    samples = delay / sample_time
    nearest = round(samples)
    if abs(samples - nearest) <= 1e-12 * max(1.0, samples):
        return nearest, 0.0
    return floor(samples), samples - floor(samples)


def sampled_plant(device: Device, whole: Number, ops: Arithmetic, *, fractional: bool) -> SampledPlant:
    """Sample the plant exactly.

    Parameters
    ----------
    device : Device
    whole : whole samples of its delay, N
    ops : arithmetic of the device's numbers
    fractional : whether a part of a sample remains, delta > 0
    """
    m, T = device.mass, device.sample_time
    rate, remainder = device.damping / m, device.delay - whole * T

    def velocity_step(t: Number) -> Number:
        return t / m * ops.decay_mean(rate * t)

    def position_step(t: Number) -> Number:
        return t * t / m * ops.decay_ramp(rate * t)

    late = T - remainder if fractional else T
    beta_0, gamma_0 = velocity_step(late), position_step(late)
    beta_1 = gamma_1 = 0
    if fractional:
        early = velocity_step(remainder)
        beta_1 = early * ops.exp(-(rate * late))
        gamma_1 = position_step(remainder) + early * (late * ops.decay_mean(rate * late))
    drift = T * ops.decay_mean(rate * T)
    return SampledPlant(
        ops.exp(-(rate * T)), rate * drift, drift, (beta_0, beta_1), (gamma_0, gamma_1), whole, fractional
    )


@dataclass(frozen=True, slots=True)
class ReturnDifference:
    """F = open + K_v velocity + K_p position at one point of the unit circle."""

    open: Pair
    velocity: Pair
    position: Pair

    def closed(self, gains: Gains) -> Pair:
        """Return F for the given gains."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)


def return_difference(plant: SampledPlant, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of F at z = e^{j theta}.

    Parameters
    ----------
    plant : SampledPlant
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of both
    position : whether the position is in the loop, K_p > 0; its part is 0 otherwise, and F that of the velocity loop
    """

    def delayed(steps: int) -> Pair:
        return Pair(ops.cos(theta * steps), -ops.sin(theta * steps))

    first = delayed(plant.whole + 1)
    second = delayed(plant.whole + 2) if plant.fractional else None

    def input_path(taps: tuple[Number, Number]) -> Pair:
        path = first.scaled(taps[0])
        return path if second is None else path + second.scaled(taps[1])

    half_sine = ops.sin(theta / 2)
    difference = Pair(2 * half_sine * half_sine, ops.sin(theta))
    decay = Pair(plant.slack + plant.pole * difference.re, plant.pole * difference.im)
    velocity = input_path(plant.velocity)
    if not position:
        return ReturnDifference(decay, velocity, Pair(0, 0))
    travel = (delayed(1) * velocity).scaled(plant.drift) + input_path(plant.position) * decay
    return ReturnDifference(decay * difference, velocity * difference, travel)


def sensitivity_abs2(parts: ReturnDifference, gains: Gains) -> Number:
    """Return |S|^2 of the sampled loop at one point of the unit circle."""
    return parts.open.abs2() / parts.closed(gains).abs2()


def difference_slope(theta: Number, ops: Arithmetic) -> Pair:
    """Return (1 - e^{-j theta})/theta, regular at theta = 0: what the integrator adds to F, divided by theta."""
    half = theta / 2
    return Pair(ops.sin(half) * ops.sinc(half), ops.sinc(theta))


def characteristic_polynomial(plant: SampledPlant, gains: Gains) -> list[Number]:
    """Return the coefficients of the sampled loop's characteristic polynomial, highest power of z first."""
    delay = [*plant.velocity] if plant.fractional else [plant.velocity[0]]
    travel = [*plant.position] if plant.fractional else [plant.position[0]]
    a, K_v, K_p = plant.pole, gains.velocity, gains.position
    order = plant.whole + len(delay)
    if K_p == 0:
        coefficients = [1, -a] + [0] * (order - 1)
        for i, beta in enumerate(delay):
            coefficients[plant.whole + 1 + i] = coefficients[plant.whole + 1 + i] + K_v * beta
        return coefficients
    coefficients = [1, -(1 + a), a] + [0] * (order - 1)
    for i, (beta, gamma) in enumerate(zip(delay, travel, strict=True)):
        at = plant.whole + 1 + i
        coefficients[at] = coefficients[at] + K_v * beta + K_p * gamma
        coefficients[at + 1] = coefficients[at + 1] - K_v * beta + K_p * (plant.drift * beta - a * gamma)
    return coefficients
